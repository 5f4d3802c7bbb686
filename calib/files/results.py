"""Results in the units of the file formats: millimetres, microradians, names that people read."""

from __future__ import annotations

from typing import Any

import numpy as np

from calib.arm.kinematics import forward
from calib.arm.robot import Robot
from calib.arrays import Array
from calib.files.levels import level_fields
from calib.identification import ADVICE, Identification, Residuals
from calib.identification.common import Shared
from calib.identification.pairs import pair_errors
from calib.poses import Poses

_MM = 1e3
_RMS_KEYS = ("nominal", "fitted_all", "fitted", "heldout", "heldout_trimmed")


def identification_fields(result: Identification) -> dict[str, Any]:
    """The fields of ``identify --json``, without provenance."""
    noise = result.noise
    interval = result.interval()
    optimism = result.optimism
    return {
        "status": result.status,
        "advice": ADVICE[result.status],
        "approach": result.approach,
        "method": result.method,
        "noise": {
            "sigma_mm": noise.sigma * _MM,
            "believed_sigma_mm": noise.believed * _MM,
            "source": noise.source,
            "replicate_sigma_mm": None
            if noise.replicate_factor is None
            else noise.replicate_factor * noise.believed * _MM,
            "lack_of_fit_p": noise.lack_of_fit_p,
            **level_fields(result.levels, result.scatter),
        },
        "poses": len(result.fit.data),
        "points": int(result.fit.data.seen.sum()),
        "rank": result.rank,
        "degrees_of_freedom": result.dof,
        "iterations": result.iterations,
        "parameters": [
            {
                "id": p.id,
                "name": p.name,
                "effect": p.effect,
                "where": p.where,
                "value": value / p.scale,
                "std": std / p.scale if std > 0.0 else None,
                "ci95": list(bounds / p.scale) if std > 0.0 else None,
                "std_by_pose": None if by_pose is None else by_pose / p.scale,
                "step_two_optimism": factor,
                "unit": p.unit,
            }
            for p, value, std, bounds, by_pose, factor in zip(
                result.model.parameters,
                result.values,
                result.std,
                interval,
                [None] * len(result.values) if result.std_by_pose is None else result.std_by_pose,
                optimism,
                strict=True,
            )
        ],
        "weak": list(result.weak),
        "unused_poses": [*result.unused, *result.waiting],
        "unidentifiable": [
            {"names": list(u.names), "reason": u.reason} for u in result.unidentifiable
        ],
        "absorbed": [
            {"id": d.id, "absorbed_by": [name for name, _ in d.absorbed_by]}
            for d in result.absorbed
        ],
        "outliers": _outliers(result.fit),
        "outliers_share": _share(result.shared),
        "heldout_outliers": [] if result.heldout is None else _outliers(result.heldout),
        "rms_mm": _summary(result, lambda d: float(np.sqrt(np.mean(d**2)))),
        "max_mm": _summary(result, lambda d: float(d.max())),
        "p95_mm": _summary(result, lambda d: float(np.quantile(d, 0.95))),
        "pair_distances_mm": _pair_distances(result),
        "rms_of_residuals_mm": float(np.sqrt(np.mean(result.fit.lengths() ** 2))) * _MM,
        "base": _bases(result),
        "markers_mm": _markers(result),
        "correlation": np.round(result.correlation, 4),
        "residuals": _residuals(result, result.fit, False)
        + ([] if result.heldout is None else _residuals(result, result.heldout, True)),
    }


def _summary(result: Identification, figure: Any) -> dict[str, float | None]:
    found = result.distances
    return {
        key: figure(found[key]) * _MM if key in found and len(found[key]) else None
        for key in _RMS_KEYS
    }


def _pair_distances(result: Identification) -> dict[str, Any]:
    """Errors of distances between points of two poses: RMS, 95th percentile, largest, their number."""
    found = {
        "nominal": pair_errors(
            result.fit.data, result.model.predict(result.nominal, result.fit.data.poses)
        ),
        "fitted": pair_errors(result.fit.data, result.fit.data.points - result.fit.vectors),
    }
    if result.heldout is not None:
        held = result.heldout
        found["heldout"] = pair_errors(held.data, held.data.points - held.vectors)
    return {
        key: {
            "rms": float(np.sqrt(np.mean(errors**2))) * _MM,
            "p95": float(np.quantile(np.abs(errors), 0.95)) * _MM,
            "max": float(np.abs(errors).max()) * _MM,
            "pairs": len(errors),
        }
        for key, errors in found.items()
        if len(errors)
    }


def _outliers(residuals: Residuals) -> list[dict[str, str]]:
    out = []
    for i in np.flatnonzero(residuals.outlier):
        largest = float(np.linalg.norm(residuals.vectors[i], axis=-1).max()) * _MM
        ratio = float(np.sqrt(residuals.statistic[i] / residuals.limit))
        out.append(
            {
                "pose": residuals.data.poses.names[i],
                "reason": f"residual up to {largest:.3f} mm, {ratio:.1f} times what the other poses "
                "allow",
            }
        )
    return out


def _share(common: Shared | None) -> dict[str, Any] | None:
    """What the outliers have in common, in the unit that it names."""
    if common is None:
        return None
    return {
        "variable": common.variable,
        "low": common.low / common.scale,
        "high": common.high / common.scale,
        "unit": common.unit,
        "poses": common.inside,
        "of_poses": common.poses,
        "outliers": common.outliers,
        "of_outliers": common.of,
        "p": common.p,
        "beyond_all_others": common.alone / common.scale if common.alone else None,
    }


def _bases(result: Identification) -> dict[str, Any]:
    """The base in the frame of the readings; with several stations, each under its name."""
    shown = {
        where: {
            "rotation_vector_rad": _shortest(placed[3:]),
            "translation_mm": list(placed[:3] * _MM),
        }
        for where, placed in result.bases.items()
    }
    if not shown:
        return {"rotation_vector_rad": [0.0] * 3, "translation_mm": [0.0] * 3}
    first = next(iter(shown.values()))
    return first if len(shown) == 1 else {**first, "stations": shown}


def _shortest(rotation: np.ndarray[Any, np.dtype[np.float64]]) -> list[float]:
    from calib.arm.se3 import so3_exp, so3_log

    return list(so3_log(so3_exp(rotation)))


def _markers(result: Identification) -> dict[str, list[float]]:
    names = result.model.marker_names
    return {n: list(p * _MM) for n, p in zip(names, result.marker_positions, strict=True)}


def _residuals(result: Identification, part: Residuals, heldout: bool) -> list[dict[str, Any]]:
    """Measured minus predicted, by the identified and by the nominal model (``nominal_mm``)."""
    names, poses = result.model.marker_names, part.data.poses
    nominal = part.data.points - result.model.predict(result.nominal, poses)
    return [
        {
            "pose": poses.names[i],
            "marker": names[j],
            **dict(
                zip(("x_mm", "y_mm", "z_mm"), map(float, part.vectors[i, j] * _MM), strict=True)
            ),
            "nominal_mm": nominal[i, j] * _MM,
            "heldout": heldout,
        }
        for i, j in np.argwhere(part.data.seen)
    ]


def at_targets(robot: Robot, targets: Poses, errors: Array) -> list[dict[str, float]]:
    """Where each target puts the tip (nominal model, base frame), and the error expected there.

    errors : ndarray, shape (m,), m
    """
    tips = forward(robot, targets.q).o[:, -1] * _MM
    return [
        {"tip_x_mm": x, "tip_y_mm": y, "tip_z_mm": z, "expected_mm": error * _MM}
        for (x, y, z), error in zip(tips.tolist(), errors.tolist(), strict=True)
    ]
