"""From a comparison of plans to the record of it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from calib.arrays import Array
from calib.cell import Cell
from calib.effects.protocol import Parameter
from calib.effects.tool import Tool
from calib.model.covariance import correlation
from calib.observations import orientable
from studies.compare.agreement import BELIEVED, FEWEST, Agreement, band
from studies.compare.compare import PlanComparison, PlanStudy, Reason, Verdict
from studies.compare.montecarlo import FromScratch, surprising
from studies.compare.prediction import by_markers, by_poses, influence_by_effect
from studies.compare.record import (
    AgreementEntry,
    ByNumber,
    ComparedApproach,
    ComparedParameter,
    ComparedPlan,
    CompareRecord,
    CorrelatedPair,
    FromScratchEntry,
    ImprovementFactor,
    PoseLeverage,
    ReadBy,
)
from studies.record import Envelope

_MM = 1e3
_NO_PLACE = (
    "the cell does not say where the instrument stands ([instrument] position_mm): its ranges count "
    "from the robot's base"
)
_PAIRS = 6  # error ellipses: the parameters most entangled
_POINTS = 400  # simulated experiments of an ellipse that are kept; more only darken its cloud


def compare_record(
    found: PlanComparison,
    made_from: Envelope,
    *,
    curves: bool = False,
    read_by: Sequence[ReadBy] = (),
) -> CompareRecord:
    """The record of a comparison.

    read_by : its plans as the instruments of several cells read them, those of this cell first
    curves : whether to predict for fewer poses and markers too, which takes as long as 200 plans
    """
    tool = bool(len(found.plans[0].experiment.model.where(Tool)))
    return CompareRecord.from_result(
        found,
        **made_from,
        warnings=(),
        plans=tuple(_plan(found.cell, study, curves) for study in found.plans),
        task_at="markers" if tool else "tip origin",
        notes=(_NO_PLACE,) if found.cell.noise.grows and found.cell.instrument is None else (),
        agreement=_agreement(found),
        read_by=tuple(read_by),
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


def _plan(cell: Cell, study: PlanStudy, curves: bool) -> ComparedPlan:
    experiment, count = study.experiment, len(study.plan)
    markers = experiment.model.marker_positions(experiment.nominal)
    points = experiment.seen if experiment.seen.shape[1] == len(markers) else None
    covariance = study.points.prediction.covariance
    R = correlation(covariance)
    shares, effects = influence_by_effect(experiment, study.points.prediction, count)
    return ComparedPlan.from_result(
        study,
        poses=count,
        readings=len(experiment.poses),
        hidden_markers=int((~experiment.seen).sum()),
        readings_without_pose=0 if points is None else int((~orientable(markers, points)).sum()),
        approaches=[_approach(study, verdict) for verdict in study.verdicts],
        improvement=()
        if study.improvement is None
        else ImprovementFactor.from_each(_parameters(study), factor=study.improvement),
        by_pose=[
            PoseLeverage(
                pose=name,
                parameters_worth=float(share.sum()),
                effects=dict(zip(effects, share.tolist(), strict=True)),
            )
            for name, share in zip(study.plan.names, shares, strict=True)
        ],
        correlation=np.where(np.diag(covariance) > 0.0, R, np.nan).round(4),
        entangled=_entangled(study, R),
        by_poses=by_poses(cell, experiment, count) if curves else ByNumber(),
        by_markers=by_markers(cell, study.plan, experiment.length) if curves else ByNumber(),
    )


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
        from_scratch=_from_scratch(study.refits.scratch.get(way.key, [])),
    )


def _from_scratch(done: Sequence[FromScratch]) -> FromScratchEntry | None:
    if not done:
        return None
    return FromScratchEntry(
        trials=len(done),
        same=sum(own.same for own in done),
        with_outliers=sum(own.outliers > 0 for own in done),
        noise=dict(Counter(own.noise for own in done)),
        farthest_in_standard_deviations=max(own.apart for own in done),
    )


def _entangled(study: PlanStudy, R: Array) -> tuple[CorrelatedPair, ...]:
    """The robot's parameters that go together most, or all parameters where it has but one."""
    parameters = _parameters(study)
    own = [i for i, p in enumerate(parameters) if p.effect not in ("base", "tool")]
    own = own if len(own) > 1 else list(range(len(parameters)))
    ranked = sorted(
        ((abs(R[a, b]), a, b) for n, a in enumerate(own) for b in own[n + 1 :]), reverse=True
    )
    return tuple(_pair(study, [a, b]) for _, a, b in ranked[:_PAIRS])


def _pair(study: PlanStudy, pair: list[int]) -> CorrelatedPair:
    a, b = (_parameters(study)[i] for i in pair)
    scales = np.array([a.scale, b.scale])
    covariance, simulated = {}, {}
    for v in study.verdicts:
        C = v.prediction.covariance[np.ix_(pair, pair)] / np.outer(scales, scales)
        covariance[v.way.key] = ((C[0, 0], C[0, 1]), (C[1, 0], C[1, 1]))
        if v.agreement is not None:
            errors = study.refits.of(v.way.key)[:_POINTS, pair] / scales
            simulated[v.way.key] = tuple((float(x), float(y)) for x, y in errors)
    return CorrelatedPair(ids=(a.id, b.id), covariance=covariance, simulated=simulated)


# -- whether to believe it ---------------------------------------------------------------------


_SAYS: dict[Reason, str] = {
    "derivative": "a derivative that the prediction rests on is wrong, and nonlinearity explains "
    "nothing here",
    "chance": "this may be chance: repeat with another --seed or more trials",
    "weights": "the fits are weighted by other noise than the cell states, a fault of the program: its "
    "standard deviations are wrong",
    "arm": "even without noise the fits end beside the truth: the arm that is fitted is not the one "
    "that was measured, so its kinematics, torques or masses are wrong",
    "truth": "predicted at the simulated robot it agrees: the robot's errors change what the plan "
    "tells, so predict at identified values (--values)",
    "noise": "at a tenth of the noise it agrees: the fits are not linear in noise of this size; more "
    "poses, spread wider, would help",
    "unknown": "neither the robot's errors nor the size of the noise explains it: believe the "
    "simulated figures",
}
_UNSETTLED = 0.01
"""Share of fits that may fail to settle before the rest says too little."""


def judgement(result: PlanComparison) -> tuple[bool | None, str]:
    """Whether to believe the prediction, and if not, why and by how much.

    None where too little was simulated to tell.
    """
    for study in result.plans:
        if study.slopes.wrong:
            return False, (
                f"refuted at {study.name}: the derivative by {study.slopes.parameter} is "
                f"{100.0 * study.slopes.off:.3g} % off the model's own slope, a fault of the program "
                "or of an added effect; what is predicted rests on it"
            )
    if not result.trials:
        return None, "nothing was simulated"
    if result.trials < FEWEST:
        few = f"{result.trials} simulated experiments are too few to tell"
        return None, f"{few}: simulate {FEWEST} or more"
    pairs = [(study, v) for study in result.plans for v in study.verdicts]
    study, verdict = max(pairs, key=lambda pair: pair[1].unsettled)
    if verdict.unsettled > _UNSETTLED * result.trials:
        return False, (
            f"{verdict.unsettled} of {study.refits.trials} fits of {verdict.way.key} at "
            f"{study.name} did not converge: the plan hardly determines the model"
        )
    if result.p is not None and result.p >= BELIEVED:
        astray = _astray(result)
        return astray is None, astray or "simulation and prediction agree"
    tested = [(study, v, v.agreement) for study, v in pairs if v.agreement is not None]
    study, verdict, found = min(tested, key=lambda own: own[2].p)
    why = _SAYS[verdict.reason or "chance"]
    return False, f"refuted at {study.name}, {verdict.way.key}: {_failed(study, found)}; {why}"


def _astray(result: PlanComparison) -> str | None:
    """What trials that were identified from scratch did otherwise than their refits, if too many."""
    for study in result.plans:
        for key, done in study.refits.scratch.items():
            elsewhere, noisy, left = surprising(done)
            if elsewhere:
                count = sum(not own.same for own in done)
                return (
                    f"refuted at {study.name}, {key}: {count} of {len(done)} fits from raw data end "
                    "elsewhere than fits that start at the true robot: start values or outliers "
                    "mislead them"
                )
            if left:
                return (
                    f"refuted at {study.name}, {key}: the residuals of {len(done)} fits from raw "
                    "data do not agree with their degrees of freedom: the program counts these wrongly"
                )
            if noisy:
                count = sum(own.noise != "cell" for own in done)
                return (
                    f"refuted at {study.name}, {key}: {count} of {len(done)} fits from raw data "
                    "estimate another noise than the cell states"
                )
    return None


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
