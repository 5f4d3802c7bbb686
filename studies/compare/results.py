"""A comparison in the units of the file formats."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from studies.compare.agreement import BELIEVED, Agreement, band
from studies.compare.anatomy import influence
from studies.compare.compare import Comparison, PlanStudy, Verdict
from studies.compare.experiment import POINTS

_MM = 1e3
_MATTERS = 1.02  # change of a standard deviation that is worth a word


def comparison_fields(result: Comparison) -> dict[str, Any]:
    """The fields of ``compare --json``, without provenance."""
    ratios = sum(int(np.isfinite(found.ratio).sum()) for found in result.agreements)
    return {
        "plans": [_plan(study) for study in result.plans],
        "targets": str(result.cell.design.get("targets") or "200 Sobol poses"),
        "trials": result.trials,
        "trials_asked": result.asked,
        "agreement": {
            "worst_ratio": result.worst_ratio,
            "chi2_p": result.p,
            "ratio_band95": _band(result.trials, 0.95),
            "worst_ratio_band95": _band(result.trials, 1.0 - 0.05 / max(1, ratios)),
            "ratios": ratios,
            "believed": None if result.p is None else result.p >= BELIEVED,
            "says": _says(result),
        },
    }


def _band(trials: int, level: float) -> list[float]:
    return list(band(trials, level)) if trials > 1 else [math.nan, math.nan]


def _plan(study: PlanStudy) -> dict[str, Any]:
    parameters, factors = study.experiment.model.parameters, study.improvement
    points = study.of(POINTS)
    shares = None
    if points is not None:
        shares = np.nansum(influence(study.experiment, points.prediction, len(study.plan)), axis=1)
    return {
        "plan": study.name,
        "poses": len(study.plan),
        "readings": len(study.experiment.poses),
        "trials": study.refits.trials,
        "hidden_markers": int((~study.experiment.seen).sum()),
        "approaches": [_approach(study, verdict) for verdict in study.verdicts],
        "improvement": []
        if factors is None
        else [
            {"name": p.name, "effect": p.effect, "where": p.where, "id": p.id, "factor": factor}
            for p, factor in zip(parameters, factors, strict=True)
        ],
        "by_pose": [
            {"pose": name, "parameters_worth": share}
            for name, share in zip(
                study.plan.names, shares if shares is not None else [], strict=False
            )
        ],
    }


def _approach(study: PlanStudy, verdict: Verdict) -> dict[str, Any]:
    found, way = verdict.agreement, verdict.way
    parameters = study.experiment.model.parameters
    nothing = np.full(len(parameters), np.nan)
    simulated = nothing if found is None else found.std
    bias = nothing if found is None else found.bias_share
    settled = study.refits.settled.get(way.key)
    return {
        "approach": way.approach,
        "weighting": way.weighting,
        "length_mm": study.experiment.length * _MM if way.weighting == "plain" else None,
        "parameters": [
            {
                "name": p.name,
                "effect": p.effect,
                "where": p.where,
                "id": p.id,
                "std": std / p.scale,
                "unit": p.unit,
                "monte_carlo_std": own / p.scale,
                "monte_carlo_bias_in_standard_errors": shift,
            }
            for p, std, own, shift in zip(
                parameters, verdict.prediction.std, simulated, bias, strict=True
            )
        ],
        "task_rms_mm": verdict.task_rms * _MM,
        "task_worst_mm": verdict.task_worst * _MM,
        "monte_carlo_task_rms_mm": verdict.simulated_rms * _MM,
        "not_converged": None if settled is None else int((~settled).sum()),
        "agreement": None if found is None else _agreement(found),
    }


def _agreement(found: Agreement) -> dict[str, float]:
    return {
        "worst_ratio": found.worst_ratio,
        "variance_ratio": found.total,
        "chi2_p": found.p,
    }


def _says(result: Comparison) -> str:
    """Whether to believe the prediction, and if not, why and by how much."""
    if result.p is None or result.worst_ratio is None:
        return "nothing was simulated"
    if result.p >= BELIEVED:
        return "simulation and prediction agree"
    worst = min(
        ((s, v) for s in result.plans for v in s.verdicts if v.agreement is not None),
        key=lambda pair: pair[1].agreement.p,  # type: ignore[union-attr]
    )
    study, verdict = worst
    found = verdict.agreement
    assert found is not None  # noqa: S101  the ones without were left out above
    ratio = np.where(np.isfinite(found.ratio), found.ratio, 1.0)
    where = int(np.abs(np.log(ratio)).argmax())
    name = study.experiment.model.parameters[where].id
    scatter = 100.0 * (ratio[where] - 1.0)
    shift = np.nan_to_num(found.bias / verdict.prediction.std)
    moved = int(np.abs(shift).argmax())
    changed = study.changed[np.isfinite(study.changed)]
    text = (
        f"simulation disagrees most at {study.name}, {verdict.way.key}: {name} scatters "
        f"{scatter:+.0f} % from its prediction, {study.experiment.model.parameters[moved].id} is off "
        f"by {abs(shift[moved]):.2f} standard deviations in the mean; "
    )
    if max(changed.max(initial=1.0), 1.0 / changed.min(initial=1.0)) > _MATTERS:
        return text + "the robot's errors change the standard deviations: predict with --values"
    return (
        text + "the estimate is not linear in so large a noise: measure more poses, or closer ones"
    )
