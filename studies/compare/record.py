"""What ``posecal compare`` finds."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from studies.document import WHOLE, Shown
from studies.record import (
    OWN_UNIT,
    Count,
    Entry,
    Envelope,
    From,
    Maybe,
    Number,
    Positive,
    Record,
)

if TYPE_CHECKING:
    from calib.arrays import Array
    from calib.cell import Cell
    from calib.effects.protocol import Parameter
    from studies.compare.compare import PlanComparison, PlanStudy, Verdict
    from studies.compare.montecarlo import FromScratch as Scratch

_MM = 1e3
_PAIRS = 6  # error ellipses: the parameters most entangled
_POINTS = 400  # simulated experiments of an ellipse that are kept; more only darken its cloud

Pair = tuple[Number, Number]
Outline = tuple[Pair, Pair]


class ComparedParameter(Entry):
    """How well a parameter is known, predicted and from the scatter of simulated experiments."""

    name: str
    effect: str
    where: str
    id: str
    std: Annotated[Maybe, OWN_UNIT]
    unit: str
    monte_carlo_std: Annotated[Maybe, OWN_UNIT]
    monte_carlo_bias_in_standard_errors: Maybe


class FromScratchEntry(Entry):
    """Experiments identified as real data are: start values, outliers and noise of their own."""

    trials: Count
    same: Count
    with_outliers: Count
    noise: dict[str, Count]
    farthest_in_standard_deviations: Maybe


class Tested(Entry):
    """Simulation against one prediction, by chi-square tests."""

    worst_ratio: Maybe
    variance_ratio: Annotated[Maybe, From("total")]
    chi2_p: Annotated[Number, From("p")]
    tests: dict[str, Number]


class Approach(Entry):
    """A plan under one approach and weighting."""

    approach: Literal["points", "pose"]
    weighting: Literal["full", "normalised", "plain"]
    length_mm: Positive | None
    parameters: tuple[ComparedParameter, ...]
    task_rms_mm: Maybe
    task_worst_mm: Maybe
    monte_carlo_task_rms_mm: Annotated[Maybe, From("simulated_rms")]
    not_converged: Annotated[Count, From("unsettled")]
    from_scratch: FromScratchEntry | None
    agreement: Tested | None
    reason: str | None

    @property
    def key(self) -> str:
        """``points``, ``pose plain``, .."""
        return "points" if self.approach == "points" else f"pose {self.weighting}"


class Factor(Entry):
    """Plain approach #1 over approach #2; None where they determine different parameters."""

    name: str
    effect: str
    where: str
    id: str
    factor: Maybe


class Worth(Entry):
    """What a pose counts for in the variances; ``effects`` sums it over those of each effect."""

    pose: str
    parameters_worth: Number
    effects: dict[str, Number] = Field(default_factory=dict)


class DerivativesEntry(Entry):
    """How far a derivative is off the model's own slope, where it is farthest."""

    worst_relative_error: Annotated[Maybe, From("off")]
    id: Annotated[str, From("parameter")]


class Entangled(Entry):
    """Two parameters that go together: covariances and simulated errors by approach, in their units."""

    ids: tuple[str, str]
    covariance: dict[str, Outline]
    simulated: dict[str, tuple[Pair, ...]]


class ByNumber(Entry):
    """Task RMS by a number of poses or markers, median over subsets, by approach."""

    counts: tuple[Count, ...] = ()
    task_rms_mm: Annotated[dict[str, tuple[Maybe, ...]], From("rms")] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _one_each(self) -> Self:
        if any(len(values) != len(self.counts) for values in self.task_rms_mm.values()):
            raise ValueError("task_rms_mm and counts are of different lengths")
        return self


class Plan(Entry):
    """One plan under every approach, the last of them that of points."""

    plan: Annotated[str, From("name")]
    poses: Count
    readings: Count
    trials: Annotated[Count, From("refits.trials")]
    derivatives: Annotated[DerivativesEntry, From("slopes")]
    hidden_markers: Count
    readings_without_pose: Count
    approaches: tuple[Approach, ...] = Field(min_length=1)
    improvement: tuple[Factor, ...]
    by_pose: tuple[Worth, ...]
    correlation: tuple[tuple[Maybe, ...], ...] = ()
    entangled: tuple[Entangled, ...] = ()
    by_poses: ByNumber = ByNumber()
    by_markers: ByNumber = ByNumber()

    @model_validator(mode="after")
    def _belongs_together(self) -> Self:
        if self.points.approach != "points":
            raise ValueError("approach points is not the last")
        ids = [p.id for p in self.points.parameters]
        if any([p.id for p in own.parameters] != ids for own in self.approaches):
            raise ValueError("approaches have other parameters")
        if self.improvement and [f.id for f in self.improvement] != ids:
            raise ValueError("improvement has other parameters")
        if any(len(row) != len(ids) for row in self.correlation) or len(self.correlation) not in (
            0, len(ids),
        ):  # fmt: skip
            raise ValueError("correlation is not of the parameters")
        if len({tuple(worth.effects) for worth in self.by_pose}) > 1:
            raise ValueError("by_pose has other effects from pose to pose")
        if any(not set(pair.ids) <= set(ids) for pair in self.entangled):
            raise ValueError("entangled has other parameters")
        if len({(*pair.covariance, "|", *pair.simulated) for pair in self.entangled}) > 1:
            raise ValueError("entangled has other approaches from pair to pair")
        return self

    @property
    def points(self) -> Approach:
        """Under approach #2, which any markers allow."""
        return self.approaches[-1]

    @property
    def ids(self) -> tuple[str, ...]:
        """Identifiers of the parameters."""
        return tuple(p.id for p in self.points.parameters)

    def of(self, key: str) -> Approach | None:
        """Under one approach, None where the markers do not allow it."""
        return next((own for own in self.approaches if own.key == key), None)


class ReadBy(Entry):
    """A plan as the instruments of a cell read it, and what the arm's own scatter leaves alone.

    poses_to_match : how many such poses leave what the first cell's instruments leave
    """

    cell: str
    instruments: tuple[str, ...]
    plan: str
    poses: Count
    task_rms_mm: Annotated[Maybe, Shown("task RMS")]
    task_worst_mm: Annotated[Maybe, Shown("at worst")]
    arm_rms_mm: Annotated[Maybe, Shown("arm alone")]
    poses_to_match: Annotated[Maybe, Shown("poses to\nmatch", WHOLE)]


class AgreementEntry(Entry):
    """Whether the prediction can be believed, over all plans and approaches."""

    worst_ratio: Maybe
    chi2_p: Annotated[Maybe, From("p")]
    ratio_band95: tuple[Maybe, Maybe]
    worst_ratio_band99: tuple[Maybe, Maybe]
    ratios: Count
    believed: bool | None
    says: str


class CompareRecord(Record):
    """Which approach, which weighting, which plan, and whether it can be believed.

    truth_note : what keeps readings from MuJoCo's arm where nobody chose; empty where nothing does
    """

    command: Literal["compare"] = "compare"
    plans: tuple[Plan, ...] = Field(min_length=1)
    targets: Annotated[str, From("cell.targets_in_words")]
    task_at: Literal["markers", "tip origin"]
    notes: tuple[str, ...]
    trials: Count
    trials_asked: Annotated[Count, From("asked")]
    truth: Literal["model", "mujoco"]
    truth_note: Annotated[str, From("why_not")] = ""
    agreement: AgreementEntry
    read_by: tuple[ReadBy, ...] = ()


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
    from calib.effects.tool import Tool

    tool = bool(len(found.plans[0].experiment.model.where(Tool)))
    return CompareRecord.from_result(
        found,
        **made_from,
        warnings=(),
        plans=tuple(_plan(found.cell, study, curves) for study in found.plans),
        task_at="markers" if tool else "tip origin",
        notes=_notes(found.cell),
        agreement=_agreement(found),
        read_by=tuple(read_by),
    )


def _notes(cell: Cell) -> tuple[str, ...]:
    if not cell.noise.grows or cell.instrument is not None:
        return ()
    return (
        "the cell does not say where the instrument stands ([instrument] position_mm): its ranges "
        "count from the robot's base",
    )


def _agreement(found: PlanComparison) -> AgreementEntry:
    from studies.compare.agreement import BELIEVED, band
    from studies.compare.judgement import believed, says

    ratios = sum(int(np.isfinite(own.ratio).sum()) for own in found.agreements)
    levels = (0.95, 1.0 - BELIEVED / max(1, ratios))
    bands = [band(found.trials, level) if found.trials > 1 else (None, None) for level in levels]
    return AgreementEntry.from_result(
        found,
        ratio_band95=bands[0],
        worst_ratio_band99=bands[1],
        ratios=ratios,
        believed=believed(found),
        says=says(found),
    )


def _plan(cell: Cell, study: PlanStudy, curves: bool) -> Plan:
    from calib.model.covariance import correlation
    from calib.observations import orientable
    from studies.compare.prediction import by_markers, by_poses, influence_by_effect

    experiment, count = study.experiment, len(study.plan)
    markers = experiment.model.marker_positions(experiment.nominal)
    points = experiment.seen if experiment.seen.shape[1] == len(markers) else None
    covariance = study.points.prediction.covariance
    R = correlation(covariance)
    shares, effects = influence_by_effect(experiment, study.points.prediction, count)
    return Plan.from_result(
        study,
        poses=count,
        readings=len(experiment.poses),
        hidden_markers=int((~experiment.seen).sum()),
        readings_without_pose=0 if points is None else int((~orientable(markers, points)).sum()),
        approaches=[_approach(study, verdict) for verdict in study.verdicts],
        improvement=()
        if study.improvement is None
        else Factor.from_each(_parameters(study), factor=study.improvement),
        by_pose=[
            Worth(
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


def _approach(study: PlanStudy, verdict: Verdict) -> Approach:
    found, way = verdict.agreement, verdict.way
    parameters = _parameters(study)
    nothing = np.full(len(parameters), np.nan)
    return Approach.from_result(
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


def _from_scratch(done: Sequence[Scratch]) -> FromScratchEntry | None:
    if not done:
        return None
    return FromScratchEntry(
        trials=len(done),
        same=sum(own.same for own in done),
        with_outliers=sum(own.outliers > 0 for own in done),
        noise=dict(Counter(own.noise for own in done)),
        farthest_in_standard_deviations=max(own.apart for own in done),
    )


def _entangled(study: PlanStudy, R: Array) -> tuple[Entangled, ...]:
    """The robot's parameters that go together most, or all parameters where it has but one."""
    parameters = _parameters(study)
    own = [i for i, p in enumerate(parameters) if p.effect not in ("base", "tool")]
    own = own if len(own) > 1 else list(range(len(parameters)))
    ranked = sorted(
        ((abs(R[a, b]), a, b) for n, a in enumerate(own) for b in own[n + 1 :]), reverse=True
    )
    return tuple(_pair(study, [a, b]) for _, a, b in ranked[:_PAIRS])


def _pair(study: PlanStudy, pair: list[int]) -> Entangled:
    a, b = (_parameters(study)[i] for i in pair)
    scales = np.array([a.scale, b.scale])
    covariance, simulated = {}, {}
    for v in study.verdicts:
        C = v.prediction.covariance[np.ix_(pair, pair)] / np.outer(scales, scales)
        covariance[v.way.key] = ((C[0, 0], C[0, 1]), (C[1, 0], C[1, 1]))
        if v.agreement is not None:
            errors = study.refits.of(v.way.key)[:_POINTS, pair] / scales
            simulated[v.way.key] = tuple((float(x), float(y)) for x, y in errors)
    return Entangled(ids=(a.id, b.id), covariance=covariance, simulated=simulated)
