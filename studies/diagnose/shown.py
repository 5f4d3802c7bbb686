"""What the figures of a diagnosis show, as fields of its result: the fall of the error, its curves.

A report draws them from the JSON, long after the diagnosis itself is gone.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import numpy as np

from calib.arm.robot import Robot
from calib.diagnosis import Diagnosis
from calib.diagnosis.candidates import Candidate
from calib.diagnosis.error_curve import ErrorCurve, error_curve
from calib.poses import Measurements
from calib.threads import one_blas_thread
from studies.diagnose.falls import falls

_LEVELS = 3  # knots up to which a variable takes a few values only
_LEAVES_ZERO = 3.0  # standard deviations by which a direction must leave zero to be shown
_MM, _MICRO = 1e3, 1e6
_COMPONENTS = ("x", "y", "z", "rx", "ry", "rz")


@one_blas_thread
def shown_fields(result: Diagnosis) -> dict[str, Any]:
    """``steps``: the error as effects are added; ``curves``: the error of each place; ``residuals``.

    Curves are the arguments of :func:`studies.plots.error_curve.error_curve`.
    """
    fallen = falls(result)
    return {
        "steps": {
            "of": "held-out poses" if fallen.heldout else "fitted poses",
            "added": [label(candidate) for candidate in fallen.added],
            "rms_mm": [float(rms) * _MM for rms in fallen.rms],
        },
        "curves": list(_curves(result, fallen.added)),
        "residuals": [
            *_residuals(result, result.data, False),
            *([] if result.heldout is None else _residuals(result, result.heldout, True)),
        ],
    }


def _residuals(result: Diagnosis, data: Measurements, heldout: bool) -> Iterator[dict[str, Any]]:
    """Measured minus predicted at each point, before and after the found effects.

    Of a point in the instrument's frame, of the origin of a body in its own.
    """
    names = result.before.model.marker_names
    off = [fit.model.off(fit.values, data) for fit in (result.before, result.after)]
    channels = result.before.model.readout.channels
    for instrument, part in channels.blocks:
        before, after = (
            instrument.shown(*(a[:, part, : instrument.rows] for a in (data.readings, own))) * _MM
            for own in off
        )
        for i, c in np.argwhere(data.seen[:, part]):
            x, y, z = after[i, c, :3].tolist()
            yield {
                "pose": data.poses.names[i],
                "marker": names[channels.marker[part][c]],
                "instrument": instrument.name,
                "x_mm": x,
                "y_mm": y,
                "z_mm": z,
                "before_mm": before[i, c, :3],
                "heldout": heldout,
            }


def label(candidate: Candidate) -> str:
    """A cause by its name, a place without a name by what it depends on."""
    if candidate.named:
        return f"{candidate.effect.kind}:{candidate.where}"
    return f"{candidate.where} by {candidate.depends_on}, no name"


def _curves(result: Diagnosis, found: tuple[Candidate, ...]) -> Iterator[dict[str, Any]]:
    for number, candidate in enumerate(found, 1):
        curve = error_curve(result, candidate)
        if curve is not None:
            yield _curve(curve, number, result.before.model.robot)


def _curve(found: ErrorCurve, number: int, robot: Robot) -> dict[str, Any]:
    candidate = found.candidate
    variable, named = candidate.depends_on, candidate.named
    scale, variable_label = _variable(found, robot)
    few = len(found.knots) <= _LEVELS
    on_grid = np.flatnonzero(np.isin(found.grid, found.knots)) if few else slice(None)
    panels = [
        {
            "label": _axis_label(found, c, robot),
            "value": found.value[on_grid, c] * _MICRO,
            "std": found.std[on_grid, c] * _MICRO,
            "at_poses": found.at_poses[:, c] * _MICRO,
            "std_at_poses": found.std_at_poses[:, c] * _MICRO,
            "single": found.single[:, c] * _MICRO,
            "effect": found.effect[:, c] * _MICRO if named else None,
            "line": found.function[c],
        }
        for c in _clear(found)
    ]
    plain = re.sub(r"[^A-Za-z0-9]+", "_", f"{candidate.where} by {variable}")
    return {
        "name": f"error_{number}_{plain}",
        "title": f"Error of {candidate.where} over {variable}",
        "caption": _caption(found),
        "effect": label(candidate) if named else None,
        "levels": few,
        "variable_label": variable_label,
        "grid": found.grid[on_grid] * scale,
        "variable": found.variable * scale,
        "pose_names": found.poses.names,
        "panels": panels,
    }


def _clear(found: ErrorCurve) -> list[int]:
    """Directions in which the curve leaves zero; the clearest one where none does."""
    clear = np.max(np.abs(found.value) / np.where(found.std > 0.0, found.std, np.inf), axis=0)
    chosen = [c for c in range(len(clear)) if clear[c] > _LEAVES_ZERO]
    return chosen or [int(np.argmax(clear))]


def _variable(found: ErrorCurve, robot: Robot) -> tuple[float, str]:
    """Factor from SI, and the label of the axis."""
    kind, _, joint = found.candidate.depends_on.partition(":")
    slides = joint in robot.joints and bool(robot.prismatic[robot.joints.index(joint)])
    factor, unit = (1e3, "mm") if slides else (180.0 / np.pi, "deg")
    if found.load is not None:
        part = int(np.argmax(np.abs(found.load)))
        axis = "" if found.candidate.where in robot.joints else f" {'xyz'[part % 3]}"
        what, own = ("force", "N") if part < 3 else ("moment", "N m")
        return 1.0, f"transmitted {what}{axis} [{own}]"
    return {
        "q": (factor, f"{joint} [{unit}]"),
        "motion": (factor, f"last motion of {joint} [{unit}]"),
        "approach": (1.0, f"last motion of {joint}, its sign"),
        "time": (1.0 / 3600.0, "time [h]"),
        "temperature": (1.0, "temperature [degC]"),
    }[kind]


def _axis_label(found: ErrorCurve, c: int, robot: Robot) -> str:
    where, column = found.candidate.where, found.directions[:, c]
    unit = "um" if column[:3].any() else "urad"
    if where not in robot.joints:
        return f"{where} {_COMPONENTS[int(np.argmax(np.abs(column)))]} [{unit}]"
    if found.directions.shape[1] == 1:
        return f"error of {where} [{unit}]"
    axis = " ".join(f"{x:.2f}" for x in column[3:] + 0.0).replace("-", "\N{MINUS SIGN}")
    return f"tilt of {where}\nabout ({axis}) [{unit}]"


def _caption(found: ErrorCurve) -> str:
    candidate, name = found.candidate, label(found.candidate)
    where, variable = candidate.where, candidate.depends_on
    parts = [
        f"The error of {where} over {variable}: a line through knots, fitted in place of {name}, with "
        "its 95 % band. Grey points are what each pose says by itself."
        if candidate.named
        else f"The error of {where} over {variable}: a line through knots with its 95 % band. Grey "
        "points are what each pose says by itself. No cause in the catalogue has this shape."
    ]
    if candidate.named and all(found.function[c] for c in _clear(found)):
        parts.append(f"Where {name}, as fitted, keeps within the band it has the right shape.")
    elif candidate.named:
        parts.append(
            f"{name} depends on more than {variable}: a cross for each pose, to be compared with the "
            "pose's grey point."
        )
    if found.absorbed:
        parts.append(
            f"Of {len(found.knots) * found.directions.shape[1]} coefficients {found.absorbed} combined "
            "(such as a constant part) might as well be errors of what the model contains; they are "
            "taken out of all that is drawn."
        )
    if not found.converged:
        parts.append("The fit did not converge: take it as a sketch.")
    return " ".join(parts)
