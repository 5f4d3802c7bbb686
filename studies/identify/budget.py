"""The uncertainty budget of an identification, in mm at the targets."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Literal

from pydantic import Field

from studies.record import Entry, Maybe, NotNegative, Positive

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calib.uncertainty.budget import Budget, Part

_MM = 1e3
_AVERAGED = 0.5  # of what a source does to one reading, or of what it does at the targets


class Row(Entry):
    """One source at the targets, RMS over their points and over them.

    instrument : whose readings share it, empty where nothing is shared
    stated, standard_uncertainty : in ``unit``, None where the source has none of its own
    sensitivity_mm : at the targets by one ``unit``
    at_one_reading_mm : by one standard uncertainty; base_placed_anew_mm : at the targets, without what
        moves them as one
    share : of the variance in the total; degrees_of_freedom : None where it counts as known
    poses : whether many poses "average" it, as they do what is new at each reading, it goes into the
        "base", or "stays"; None where it is no error of the readings
    """

    source: str
    instrument: str
    evaluation: Literal["A", "B"]
    part_of: Literal["calibration", "arm", "model", "trend"]
    distribution: str
    divisor: Positive
    stated: Maybe
    standard_uncertainty: Maybe
    unit: str
    sensitivity_mm: Maybe
    degrees_of_freedom: Maybe
    at_one_reading_mm: Maybe
    at_targets_mm: NotNegative
    base_placed_anew_mm: NotNegative
    share: NotNegative
    poses: Literal["average", "base", "stays"] | None


class Expanded(Entry):
    """A combined standard uncertainty, and the distance within which 95 % of errors stay.

    Errors in space: the factor is Student's t where they lie along one line, less where not.
    """

    standard_uncertainty_mm: NotNegative
    coverage_factor: Positive
    expanded_mm: NotNegative
    worst_expanded_mm: NotNegative
    degrees_of_freedom: Maybe


class BudgetEntry(Entry):
    """All sources; what the parameters' uncertainty leaves, and with what the arm itself adds."""

    rows: tuple[Row, ...] = Field(min_length=1)
    calibration: Expanded
    total: Expanded
    probability: Positive

    def of(self, part: str) -> float:
        """What all rows of one part do at the targets, mm."""
        return math.hypot(*(row.at_targets_mm for row in self.rows if row.part_of == part))


def budget_entry(budget: Budget) -> BudgetEntry:
    """The entry of a budget."""
    from calib.uncertainty.expanded import LEVEL

    whole = _expanded(budget, budget.parts)
    total = whole.standard_uncertainty_mm**2
    return BudgetEntry(
        rows=tuple(_row(budget, part, total) for part in budget.parts),
        calibration=_expanded(budget, budget.calibration),
        total=whole,
        probability=LEVEL,
    )


def _expanded(budget: Budget, parts: Sequence[Part]) -> Expanded:
    from calib.uncertainty.budget import combined

    found = combined(parts, budget.weights)
    u, most = budget.rms(found.errors), budget.rms(found.expanded)
    return Expanded(
        standard_uncertainty_mm=u * _MM,
        coverage_factor=most / u if u else 1.0,
        expanded_mm=most * _MM,
        worst_expanded_mm=budget.worst(found.expanded) * _MM,
        degrees_of_freedom=found.freedom,
    )


def _row(budget: Budget, part: Part, total: float) -> Row:
    """total : variance of all, mm^2."""
    at_targets, placed = (budget.rms(e) * _MM for e in (part.errors, part.errors_placed))
    at_reading = None if part.at_reading is None else part.at_reading * _MM
    own = None if part.std is None else part.std / part.scale
    return Row(
        source=part.source,
        instrument=part.instrument,
        evaluation=part.evaluation,
        part_of=part.of,
        distribution=part.distribution,
        divisor=part.divisor,
        stated=None if part.stated is None else part.stated / part.scale,
        standard_uncertainty=own,
        unit=part.unit if own is not None else "",
        sensitivity_mm=at_targets / own if own else None,
        degrees_of_freedom=part.freedom,
        at_one_reading_mm=at_reading,
        at_targets_mm=at_targets,
        base_placed_anew_mm=placed,
        share=at_targets**2 / total if total else 0.0,
        poses=None if at_reading is None else _fate(part, at_reading, at_targets, placed),
    )


def _fate(
    part: Part, at_reading: float, at_targets: float, placed: float
) -> Literal["average", "base", "stays"]:
    if not part.instrument or at_targets < _AVERAGED * at_reading:
        return "average"
    return "base" if placed < _AVERAGED * at_targets else "stays"
