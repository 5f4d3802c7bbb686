"""What ``posecal compare`` finds."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

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
    agreement: AgreementTests | None

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


Pair = tuple[Number, Number]


class CorrelatedPair(Entry):
    """Two parameters that go together, and their covariance by approach, in their units."""

    ids: tuple[str, str]
    covariance: dict[str, tuple[Pair, Pair]]


class ComparedPlan(Entry):
    """One plan under every approach, the last of them that of points."""

    plan: Annotated[str, From("name")]
    poses: Count
    readings: Count
    hidden_markers: Count
    readings_without_pose: Count
    approaches: tuple[ComparedApproach, ...] = Field(min_length=1)
    improvement: tuple[ImprovementFactor, ...]
    entangled: tuple[CorrelatedPair, ...]

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
    """Which approach, which weighting, which plan, and whether it can be believed."""

    command: Literal["compare"] = "compare"
    plans: tuple[ComparedPlan, ...] = Field(min_length=1)
    targets: Annotated[str, From("cell.targets_in_words")]
    task_at: Literal["markers", "tip origin"]
    notes: tuple[str, ...]
    trials: Count
    agreement: AgreementEntry
