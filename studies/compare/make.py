"""From a comparison of plans to the record of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib.effects.protocol import Parameter
from calib.effects.tool import Tool
from calib.model.covariance import correlation
from calib.observations import orientable
from studies.compare.agreement import BELIEVED, FEWEST, Agreement, band
from studies.compare.compare import PlanComparison, PlanStudy, Verdict
from studies.compare.record import (
    AgreementEntry,
    ComparedApproach,
    ComparedParameter,
    ComparedPlan,
    CompareRecord,
    CorrelatedPair,
    ImprovementFactor,
)
from studies.record import Envelope

_MM = 1e3
_PAIRS = 6  # error ellipses: the parameters most entangled
_NO_PLACE = (
    "the cell does not say where the instrument stands ([instrument] position_mm): its ranges count "
    "from the robot's base"
)


def compare_record(found: PlanComparison, made_from: Envelope) -> CompareRecord:
    """The record of a comparison."""
    tool = bool(len(found.plans[0].experiment.model.where(Tool)))
    return CompareRecord.from_result(
        found,
        **made_from,
        warnings=(),
        plans=tuple(_plan(study) for study in found.plans),
        task_at="markers" if tool else "tip origin",
        notes=(_NO_PLACE,) if found.cell.noise.grows and found.cell.instrument is None else (),
        agreement=_agreement(found),
    )


def _agreement(found: PlanComparison) -> AgreementEntry:
    ratios = sum(int(np.isfinite(own.ratio).sum()) for own in found.agreements)
    levels = (0.95, 1.0 - BELIEVED / max(1, ratios))
    trusted, said = judgement(found)
    bands = [band(found.trials, level) if found.trials > 1 else (None, None) for level in levels]
    return AgreementEntry.from_result(
        found,
        ratio_band95=bands[0],
        worst_ratio_band99=bands[1],
        ratios=ratios,
        believed=trusted,
        says=said,
    )


def _plan(study: PlanStudy) -> ComparedPlan:
    experiment = study.experiment
    markers = experiment.model.marker_positions(experiment.nominal)
    points = experiment.seen if experiment.seen.shape[1] == len(markers) else None
    return ComparedPlan.from_result(
        study,
        poses=len(study.plan),
        readings=len(experiment.poses),
        hidden_markers=int((~experiment.seen).sum()),
        readings_without_pose=0 if points is None else int((~orientable(markers, points)).sum()),
        approaches=[_approach(study, verdict) for verdict in study.verdicts],
        improvement=()
        if study.improvement is None
        else ImprovementFactor.from_each(_parameters(study), factor=study.improvement),
        entangled=_entangled(study),
    )


def _entangled(study: PlanStudy) -> tuple[CorrelatedPair, ...]:
    """The robot's parameters that go together most, or all parameters where it has but one."""
    parameters, R = _parameters(study), correlation(study.points.prediction.covariance)
    own = [i for i, p in enumerate(parameters) if p.effect not in ("base", "tool")]
    own = own if len(own) > 1 else list(range(len(parameters)))
    ranked = sorted(
        ((abs(R[a, b]), a, b) for n, a in enumerate(own) for b in own[n + 1 :]), reverse=True
    )
    return tuple(_pair(study, [a, b]) for _, a, b in ranked[:_PAIRS])


def _pair(study: PlanStudy, pair: list[int]) -> CorrelatedPair:
    a, b = (_parameters(study)[i] for i in pair)
    scales = np.array([a.scale, b.scale])
    covariance = {}
    for v in study.verdicts:
        C = v.prediction.covariance[np.ix_(pair, pair)] / np.outer(scales, scales)
        covariance[v.way.key] = ((C[0, 0], C[0, 1]), (C[1, 0], C[1, 1]))
    return CorrelatedPair(ids=(a.id, b.id), covariance=covariance)


def _parameters(study: PlanStudy) -> Sequence[Parameter]:
    return study.experiment.model.parameters


def _approach(study: PlanStudy, verdict: Verdict) -> ComparedApproach:
    found, way = verdict.agreement, verdict.way
    parameters = _parameters(study)
    nothing = np.full(len(parameters), np.nan)
    return ComparedApproach.from_result(
        verdict,
        way,
        length_mm=study.experiment.length * _MM if way.weighting == "plain" else None,
        parameters=ComparedParameter.from_each(
            parameters,
            std=verdict.prediction.std,
            monte_carlo_std=nothing if found is None else found.std,
            monte_carlo_bias_in_standard_errors=nothing if found is None else found.bias_share,
        ),
    )


_UNSETTLED = 0.01
"""Share of fits that may fail to settle before the rest says too little."""


def judgement(result: PlanComparison) -> tuple[bool | None, str]:
    """Whether to believe the prediction, and if not, by how much it is off.

    None where too little was simulated to tell.
    """
    if not result.trials:
        return None, "nothing was simulated"
    if result.trials < FEWEST:
        few = f"{result.trials} simulated experiments are too few to tell"
        return None, f"{few}: simulate {FEWEST} or more"
    pairs = [(study, v) for study in result.plans for v in study.verdicts]
    study, verdict = max(pairs, key=lambda pair: pair[1].unsettled)
    if verdict.unsettled > _UNSETTLED * result.trials:
        return False, (
            f"{verdict.unsettled} of {result.trials} fits of {verdict.way.key} at "
            f"{study.name} did not converge: the plan hardly determines the model"
        )
    if result.p is not None and result.p >= BELIEVED:
        return True, "simulation and prediction agree"
    tested = [(study, v, v.agreement) for study, v in pairs if v.agreement is not None]
    study, verdict, found = min(tested, key=lambda own: own[2].p)
    return False, (
        f"refuted at {study.name}, {verdict.way.key}: {_failed(study, found)}; believe the simulated "
        "figures"
    )


def _failed(study: PlanStudy, found: Agreement) -> str:
    """Which test failed most, and by how much."""
    worst = min(found.tests, key=lambda name: found.tests[name])
    if worst == "bias":
        return f"the mean error is {found.shift:.3g} standard deviations in every direction"
    if worst == "left":
        return f"the residuals differ from the noise by {100.0 * (found.left**0.5 - 1.0):+.3g} %"
    if worst == "scatter":
        return f"all directions together scatter {100.0 * (found.total**0.5 - 1.0):+.3g} %"
    ratio = np.where(np.isfinite(found.ratio), found.ratio, 1.0)
    where = int(np.abs(np.log(ratio)).argmax())
    name = study.experiment.model.parameters[where].id
    return f"{name} scatters {100.0 * (ratio[where] - 1.0):+.3g} %"
