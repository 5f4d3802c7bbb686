"""What ``posecal compare`` finds."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from studies.document import WHOLE, Shown
from studies.record import (
    OWN_UNIT,
    Count,
    Entry,
    From,
    Maybe,
    Number,
    Positive,
    Record,
)

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


class AgreementTests(Entry):
    """Simulation against one prediction, by chi-square tests."""

    worst_ratio: Maybe
    variance_ratio: Annotated[Maybe, From("total")]
    chi2_p: Annotated[Number, From("p")]
    tests: dict[str, Number]


class ComparedApproach(Entry):
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
    agreement: AgreementTests | None
    reason: str | None

    @property
    def key(self) -> str:
        """``points``, ``pose plain``, .."""
        return "points" if self.approach == "points" else f"pose {self.weighting}"


class ImprovementFactor(Entry):
    """Plain approach #1 over approach #2; None where they determine different parameters."""

    name: str
    effect: str
    where: str
    id: str
    factor: Maybe


class PoseLeverage(Entry):
    """What a pose counts for in the variances; ``effects`` sums it over those of each effect."""

    pose: str
    parameters_worth: Number
    effects: dict[str, Number]


class DerivativesEntry(Entry):
    """How far a derivative is off the model's own slope, where it is farthest."""

    worst_relative_error: Annotated[Maybe, From("off")]
    id: Annotated[str, From("parameter")]


class CorrelatedPair(Entry):
    """Two parameters that go together: covariances and simulated errors by approach, in their units."""

    ids: tuple[str, str]
    covariance: dict[str, Outline]
    simulated: dict[str, tuple[Pair, ...]]


class ByNumber(Entry):
    """Task RMS by a number of poses or markers, median over subsets, by approach."""

    counts: tuple[Count, ...] = ()
    task_rms_mm: Annotated[dict[str, tuple[Maybe, ...]], From("rms")] = Field(default_factory=dict)


class ComparedPlan(Entry):
    """One plan under every approach, the last of them that of points."""

    plan: Annotated[str, From("name")]
    poses: Count
    readings: Count
    trials: Annotated[Count, From("refits.trials")]
    derivatives: Annotated[DerivativesEntry, From("slopes")]
    hidden_markers: Count
    readings_without_pose: Count
    approaches: tuple[ComparedApproach, ...] = Field(min_length=1)
    improvement: tuple[ImprovementFactor, ...]
    by_pose: tuple[PoseLeverage, ...]
    correlation: tuple[tuple[Maybe, ...], ...]
    entangled: tuple[CorrelatedPair, ...]
    by_poses: ByNumber = ByNumber()
    by_markers: ByNumber = ByNumber()

    @property
    def points(self) -> ComparedApproach:
        """Under approach #2, which any markers allow."""
        return self.approaches[-1]

    @property
    def ids(self) -> tuple[str, ...]:
        """Identifiers of the parameters."""
        return tuple(p.id for p in self.points.parameters)

    def of(self, key: str) -> ComparedApproach | None:
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
    plans: tuple[ComparedPlan, ...] = Field(min_length=1)
    targets: Annotated[str, From("cell.targets_in_words")]
    task_at: Literal["markers", "tip origin"]
    notes: tuple[str, ...]
    trials: Count
    trials_asked: Annotated[Count, From("asked")]
    truth: Literal["model", "mujoco"]
    truth_note: Annotated[str, From("why_not")]
    agreement: AgreementEntry
    read_by: tuple[ReadBy, ...]
