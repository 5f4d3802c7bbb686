"""A comparison in the units of the file formats."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from calib.cell import Cell
from calib.effects.tool import Tool
from calib.observations import orientable
from studies.compare.agreement import BELIEVED, FEWEST, Agreement, band
from studies.compare.anatomy import influence
from studies.compare.compare import Comparison, PlanStudy, Verdict
from studies.compare.refutation import SAYS
from studies.compare.scratch import FromScratch, surprising

_MM = 1e3
UNSETTLED = 0.01
"""Share of fits that may fail to settle before the rest says too little."""


def comparison_fields(result: Comparison) -> dict[str, Any]:
    """The fields of ``compare --json``, without provenance."""
    tool = bool(len(result.plans[0].experiment.model.where(Tool)))
    ratios = sum(int(np.isfinite(found.ratio).sum()) for found in result.agreements)
    return {
        "plans": [_plan(study) for study in result.plans],
        "targets": str(result.cell.design.get("targets") or "200 Sobol poses"),
        "task_at": "markers" if tool else "tip origin",
        "notes": _notes(result.cell),
        "trials": result.trials,
        "trials_asked": result.asked,
        "truth": result.truth,
        "agreement": {
            "worst_ratio": result.worst_ratio,
            "chi2_p": result.p,
            "ratio_band95": _band(result.trials, 0.95),
            "worst_ratio_band99": _band(result.trials, 1.0 - BELIEVED / max(1, ratios)),
            "ratios": ratios,
            "believed": _believed(result),
            "says": _says(result),
        },
    }


def _notes(cell: Cell) -> list[str]:
    if cell.noise.grows and cell.instrument is None:
        return [
            "the cell does not say where the instrument stands ([instrument] position_mm): its ranges "
            "count from the robot's base"
        ]
    return []


def _band(trials: int, level: float) -> list[float]:
    return list(band(trials, level)) if trials > 1 else [math.nan, math.nan]


def _plan(study: PlanStudy) -> dict[str, Any]:
    parameters, factors = study.experiment.model.parameters, study.improvement
    share = influence(study.experiment, study.points.prediction, len(study.plan))
    return {
        "plan": study.name,
        "poses": len(study.plan),
        "readings": len(study.experiment.poses),
        "trials": study.refits.trials,
        "derivatives": {"worst_relative_error": study.slopes.off, "id": study.slopes.parameter},
        "hidden_markers": int((~study.experiment.seen).sum()),
        "readings_without_pose": _without_pose(study),
        "approaches": [_approach(study, verdict) for verdict in study.verdicts],
        "improvement": []
        if factors is None
        else [
            {"name": p.name, "effect": p.effect, "where": p.where, "id": p.id, "factor": factor}
            for p, factor in zip(parameters, factors, strict=True)
        ],
        "by_pose": [
            {"pose": name, "parameters_worth": worth}
            for name, worth in zip(study.plan.names, np.nansum(share, axis=1), strict=True)
        ],
    }


def _without_pose(study: PlanStudy) -> int:
    """Readings whose visible markers fix no orientation."""
    experiment = study.experiment
    markers = experiment.model.marker_positions(experiment.nominal)
    return int((~orientable(markers, experiment.seen)).sum())


def _approach(study: PlanStudy, verdict: Verdict) -> dict[str, Any]:
    found, way = verdict.agreement, verdict.way
    parameters = study.experiment.model.parameters
    nothing = np.full(len(parameters), np.nan)
    simulated = nothing if found is None else found.std
    bias = nothing if found is None else found.bias_share
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
        "not_converged": verdict.unsettled,
        "from_scratch": _from_scratch(study.refits.scratch.get(way.key, [])),
        "agreement": None if found is None else _agreement(found),
        "reason": verdict.reason,
    }


def _from_scratch(done: Sequence[FromScratch]) -> dict[str, Any] | None:
    """Trials that were identified as real data are: start values, outliers and noise of their own."""
    if not done:
        return None
    return {
        "trials": len(done),
        "same": sum(own.same for own in done),
        "with_outliers": sum(own.outliers > 0 for own in done),
        "noise": dict(Counter(own.noise for own in done)),
        "farthest_in_standard_deviations": max(own.apart for own in done),
    }


def _agreement(found: Agreement) -> dict[str, Any]:
    return {
        "worst_ratio": found.worst_ratio,
        "variance_ratio": found.total,
        "chi2_p": found.p,
        "tests": found.tests,
    }


def _believed(result: Comparison) -> bool | None:
    """Whether prediction and simulation agree; None where too little was simulated to tell."""
    verdicts = [v for study in result.plans for v in study.verdicts]
    if result.trials < FEWEST:
        return None
    lost = max(v.unsettled for v in verdicts) > UNSETTLED * result.trials
    wrong = any(study.slopes.wrong for study in result.plans) or _astray(result) is not None
    return not (lost or wrong) and result.p is not None and result.p >= BELIEVED


def _says(result: Comparison) -> str:
    """Whether to believe the prediction, and if not, why and by how much."""
    for study in result.plans:
        if study.slopes.wrong:
            return (
                f"refuted at {study.name}: the derivative by {study.slopes.parameter} is "
                f"{100.0 * study.slopes.off:.2g} % off the model's own slope, a fault of the program "
                "or of an added effect; what is predicted rests on it"
            )
    if not result.trials:
        return "nothing was simulated"
    if result.trials < FEWEST:
        return (
            f"{result.trials} simulated experiments are too few to tell: simulate {FEWEST} or more"
        )
    pairs = [(study, v) for study in result.plans for v in study.verdicts]
    study, verdict = max(pairs, key=lambda pair: pair[1].unsettled)
    if verdict.unsettled > UNSETTLED * result.trials:
        return (
            f"{verdict.unsettled} of {study.refits.trials} fits of {verdict.way.key} did not settle at "
            f"{study.name}: the plan hardly determines the model"
        )
    if result.p is not None and result.p >= BELIEVED:
        return _astray(result) or "simulation and prediction agree"
    study, verdict = min(
        (pair for pair in pairs if pair[1].agreement is not None),
        key=lambda pair: pair[1].agreement.p if pair[1].agreement is not None else 1.0,
    )
    why = SAYS[verdict.reason or "chance"]
    return f"refuted at {study.name}, {verdict.way.key}: {_failed(study, verdict)}; {why}"


def _astray(result: Comparison) -> str | None:
    """What trials that were identified from scratch did otherwise than their refits, if too many."""
    for study in result.plans:
        for key, done in study.refits.scratch.items():
            elsewhere, noisy = surprising(done)
            if elsewhere:
                count = sum(not own.same for own in done)
                return (
                    f"refuted at {study.name}, {key}: {count} of {len(done)} experiments that were "
                    "identified as real data are ended elsewhere than from the true robot: start "
                    "values or outliers lead the search astray"
                )
            if noisy:
                count = sum(own.noise != "cell" for own in done)
                return (
                    f"refuted at {study.name}, {key}: {count} of {len(done)} experiments that were "
                    "identified as real data are took their noise for other than the cell's"
                )
    return None


def _failed(study: PlanStudy, verdict: Verdict) -> str:
    """Which test failed most, and by how much."""
    found = verdict.agreement
    if found is None:
        return "no fit settled"
    worst = min(found.tests, key=lambda name: found.tests[name])
    if worst == "bias":
        return f"the mean error is {found.shift:.2g} standard deviations in every direction"
    if worst == "left":
        return (
            f"what the fits leave over is {100.0 * (found.left**0.5 - 1.0):+.2g} % beside the noise"
        )
    if worst == "scatter":
        return f"all directions together scatter {100.0 * (found.total**0.5 - 1.0):+.2g} %"
    ratio = np.where(np.isfinite(found.ratio), found.ratio, 1.0)
    where = int(np.abs(np.log(ratio)).argmax())
    name = study.experiment.model.parameters[where].id
    return f"{name} scatters {100.0 * (ratio[where] - 1.0):+.2g} %"
