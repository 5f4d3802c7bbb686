"""A diagnosis in the units of the file formats."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from calib.diagnosis import Diagnosis
from calib.diagnosis.diagnose import Cause, Hidden
from calib.diagnosis.spectra import Spectrum
from calib.files.levels import level_fields
from calib.files.spectra import spectra_fields, with_aliases

_MM = 1e3


def diagnosis_fields(result: Diagnosis, spectra: Sequence[Spectrum] = ()) -> dict[str, Any]:
    """The fields of ``diagnose --json``, without provenance.

    spectra : of the same diagnosis, where they are asked for
    """
    noise, gap, tip = result.noise, result.gap, result.after.model.robot.tip
    effects = [_cause(cause, tip) for cause in result.causes]
    with_aliases(effects, spectra)
    return {
        "verdict": result.verdict,
        "noise": {
            "sigma_mm": noise.sigma * _MM,
            "believed_sigma_mm": noise.believed * _MM,
            "source": noise.source,
            "grows_with_range": None
            if result.growth is None
            else {"nearest": result.growth.nearest, "farthest": result.growth.farthest},
            **level_fields(result.after.levels, result.stage.scatter),
        },
        "effects": effects,
        "located": [
            {
                "where": _where(place.where, tip),
                "depends_on": place.depends_on,
                "share_of_gap": _known(place.share),
            }
            for place in result.located
        ],
        "gap": {
            "floor_mm": gap.floor * _MM,
            "fit_before_mm": gap.fit_before * _MM,
            "fit_after_mm": gap.fit_after * _MM,
            "heldout_before_mm": None if gap.heldout_before is None else gap.heldout_before * _MM,
            "heldout_after_mm": None if gap.heldout_after is None else gap.heldout_after * _MM,
            "over_time_before_mm": None if gap.over_time is None else gap.over_time[0] * _MM,
            "over_time_after_mm": None if gap.over_time is None else gap.over_time[1] * _MM,
            "closed": gap.closed,
            "closed_ci95": None if gap.closed_ci95 is None else list(gap.closed_ci95),
        },
        "could_not_see": [_hidden(entry, tip) for entry in result.hidden],
        "refused": [
            {"effect": r.effect, "where": _where(r.where, tip), "reason": r.reason}
            for r in result.refused
        ],
        "not_asked": [{"effect": n.effect, "reason": n.reason} for n in result.not_asked],
        "approach_derived": bool(
            result.data.poses.approach is not None and result.data.poses.approach_derived
        ),
        "not_fitted": [
            name
            for name, waits in zip(result.data.poses.names, result.waiting, strict=True)
            if waits
        ],
        "outliers": [
            {
                "pose": name,
                "reason": f"mean square {value:.1f} of its own spread, limit {result.limit:.1f}",
            }
            for name, value, out in zip(
                result.data.poses.names, result.statistic, result.outlier, strict=True
            )
            if out
        ],
        "next_poses": [],
        "spectra": spectra_fields(spectra),
    }


def _where(where: str, tip: str) -> str:
    """The place in the words of the results: what ends at the tip belongs to the tool."""
    return "tool" if where == tip else where


def _cause(cause: Cause, tip: str) -> dict[str, Any]:
    candidate = cause.named.candidate
    return {
        "effect": candidate.effect.kind,
        "where": _where(candidate.where, tip),
        "probability": _known(cause.named.probability),
        "p_value": cause.p,
        "shape_p_value": cause.doubt.p,
        "shape_power": cause.doubt.power,
        "shape_tested": cause.doubt.tested,
        "class": [
            {
                "effect": member.effect.kind,
                "where": _where(member.where, tip),
                "probability": _known(probability),
            }
            for member, probability in cause.named.members
        ],
        "parameters": [
            {"name": p.name, "value": value / p.scale, "std": _known(std / p.scale), "unit": p.unit}
            for p, value, std in zip(
                candidate.effect.parameters, cause.values, cause.std, strict=True
            )
        ],
        "share_of_gap": _known(cause.share),
    }


def _known(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _hidden(entry: Hidden, tip: str) -> dict[str, Any]:
    seen = math.isfinite(entry.smallest)
    return {
        "effect": entry.effect,
        "where": _where(entry.where, tip),
        "minimum_detectable": entry.smallest / entry.scale if seen else None,
        "unit": entry.unit,
    }
