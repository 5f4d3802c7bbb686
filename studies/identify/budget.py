"""How sure a point at a target is, and whether held-out points are within the tolerance."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from studies import document as doc
from studies.document import STD, WHOLE, Rule, Sentence, Shown, labelled, listed, mm
from studies.record import OWN_UNIT, Entry, From, Judgement, Maybe, NotNegative, Positive

if TYPE_CHECKING:
    from calib.identification import Residuals
    from calib.prediction.budget import Budget
    from calib.prediction.budget import UncertaintySource as Source


_MM = 1e3
_AVERAGED = 0.5  # of what a source does to one reading, or of what it does at the targets
_OWN = Rule(STD.show, absent="")


class BudgetRow(Entry):
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
    instrument: Annotated[str, Shown("of")]
    evaluation: Annotated[Literal["A", "B"], Shown("type")]
    part_of: Annotated[Literal["calibration", "arm", "model"], From("of")]
    distribution: str
    divisor: Positive
    stated: Annotated[Maybe, Shown(rule=_OWN), OWN_UNIT]
    standard_uncertainty: Annotated[Maybe, Shown("u", _OWN), From("std", own_unit=True)]
    unit: Annotated[str, Shown(rule=Rule(str, absent=""))]
    sensitivity_mm: Annotated[Maybe, Shown(rule=_OWN, unit="mm/unit")]
    degrees_of_freedom: Annotated[
        Maybe, Shown("degrees of\nfreedom", Rule(WHOLE.show, "known")), From("freedom")
    ]
    at_one_reading_mm: Annotated[Maybe, Shown("one reading"), From("at_reading")]
    at_targets_mm: Annotated[NotNegative, Shown("targets")]
    base_placed_anew_mm: Annotated[NotNegative, Shown("base measured\nagain")]
    share: NotNegative
    poses: Literal["average", "base", "stays"] | None


class ExpandedUncertainty(Entry):
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

    rows: tuple[BudgetRow, ...] = Field(min_length=1)
    calibration: ExpandedUncertainty
    total: ExpandedUncertainty
    probability: Positive

    def of(self, part: str) -> float:
        """What all rows of one part do at the targets, mm."""
        return math.hypot(*(row.at_targets_mm for row in self.rows if row.part_of == part))


def budget_entry(budget: Budget) -> BudgetEntry:
    """The entry of a budget."""
    from calib.inference.coverage import LEVEL

    total = _expanded(budget, budget.parts)
    return BudgetEntry(
        rows=tuple(_row(budget, part, total.standard_uncertainty_mm**2) for part in budget.parts),
        calibration=_expanded(budget, budget.calibration),
        total=total,
        probability=LEVEL,
    )


def _expanded(budget: Budget, parts: Sequence[Source]) -> ExpandedUncertainty:
    from calib.prediction.budget import combined

    found = combined(parts, budget.weights)
    u, most = budget.rms(found.errors), budget.rms(found.expanded)
    return ExpandedUncertainty(
        standard_uncertainty_mm=u * _MM,
        coverage_factor=most / u if u else 1.0,
        expanded_mm=most * _MM,
        worst_expanded_mm=budget.worst(found.expanded) * _MM,
        degrees_of_freedom=found.freedom,
    )


def _row(budget: Budget, part: Source, total: float) -> BudgetRow:
    """total : variance of all, mm^2."""
    at_targets, placed = budget.rms(part.errors) * _MM, budget.placed_anew(part) * _MM
    at_reading = None if part.at_reading is None else part.at_reading * _MM
    own = None if part.std is None else part.std / part.scale
    fate: Literal["average", "base", "stays"] | None = None
    if at_reading is not None:
        fate = "base" if placed < _AVERAGED * at_targets else "stays"
        if not part.instrument or at_targets < _AVERAGED * at_reading:
            fate = "average"
    return BudgetRow.from_result(
        part,
        unit=part.unit if own is not None else "",
        sensitivity_mm=at_targets / own if own else None,
        at_targets_mm=at_targets,
        base_placed_anew_mm=placed,
        share=at_targets**2 / total if total else 0.0,
        poses=fate,
    )


_FATES = {
    "average": ("lower it", "more poses average out"),
    "base": ("go into the base", "mostly a shift or turn of the whole frame"),
    "stays": ("do not help", "more poses do not lower"),
}
_ROWS = doc.columns(
    BudgetRow,
    "source evaluation standard_uncertainty unit at_targets_mm base_placed_anew_mm",
    "degrees_of_freedom share",
    doc.Column("more poses", lambda row: _FATES[row.poses][0] if row.poses else "", doc.TEXT),
)
_EVALUATED = doc.columns(
    BudgetRow,
    "source instrument evaluation distribution stated divisor unit sensitivity_mm",
    "at_one_reading_mm",
)
_CAPTION = (
    "What one standard uncertainty of each source does to the points at the targets, RMS. Also "
    "with the base measured again there, as a user does who measures his own frame: what moves all "
    "targets together is gone then. Errors along one line are covered by Student's t times u, "
    "errors in space by less."
)


def budget_section(budget: BudgetEntry, targets: str, missing: bool) -> doc.Section:
    """How sure a point at a target is.

    missing : whether the model surely lacks something
    """
    title = "How sure is a point at a target?"
    return doc.Section("budget", title, tuple(_parts(budget, targets, missing)))


def _parts(budget: BudgetEntry, targets: str, missing: bool) -> Iterator[doc.Part]:
    only = ", if the model lacks nothing" if missing else ""
    yield doc.Sentence(
        f"errors up to {_covered(budget.calibration)}, from the parameters{only}", label="95 %"
    )
    if any(row.part_of != "calibration" for row in budget.rows):
        yield doc.Sentence(f"errors up to {_covered(budget.total)}, with all sources below")
    yield doc.Sentence(targets, label="targets")
    yield doc.Table(_ROWS, budget.rows, "Uncertainty budget", _CAPTION)
    yield doc.Detail(
        (doc.Table(_EVALUATED, budget.rows, "How each source was evaluated", fold=True),)
    )
    common = [row for row in budget.rows if row.instrument]
    named = {fate: [row.source for row in common if row.poses == fate] for fate in _FATES}
    said = (f"{_FATES[fate][1]}: {listed(own)}" for fate, own in named.items() if own)
    yield from labelled("common", said)
    if not common:
        yield doc.Sentence(
            "errors that all readings share: none is stated. Those of a tracker (scale, zero point, "
            "circles, air) go into [instrument.common]",
            "note", "not counted",
        )  # fmt: skip


def _covered(found: ExpandedUncertainty) -> str:
    """Both figures with their factor, as a certificate gives them."""
    nu = found.degrees_of_freedom
    behind = "" if nu is None else f", {nu:.0f} degrees of freedom"
    return (
        f"{mm(found.expanded_mm)}, {mm(found.worst_expanded_mm)} at the worst target "
        f"(k = {found.coverage_factor:.2f}{behind})"
    )


class AcceptanceEntry(Entry):
    """Whether every held-out point is within the tolerance; None where no point is held out."""

    tolerance_mm: Positive
    verdict: Literal["pass", "fail"] | None
    largest_mm: NotNegative | None

    @property
    def judgement(self) -> Judgement | None:
        """The verdict and what it rests on."""
        if self.verdict is None:
            return None
        largest = f"the largest error of held-out points is {self.largest_mm:.3g} mm"
        return Judgement(self.verdict, f"tolerance {self.tolerance_mm:g} mm: {largest}")


def acceptance_entry(tolerance: float | None, held: Residuals | None) -> AcceptanceEntry | None:
    """The entry for a tolerance, m, of held-out points."""
    if tolerance is None:
        return None
    lengths = held.lengths() if held is not None else ()
    if not len(lengths):
        return AcceptanceEntry(tolerance_mm=tolerance * _MM, verdict=None, largest_mm=None)
    largest = float(max(lengths))
    return AcceptanceEntry(
        tolerance_mm=tolerance * _MM,
        verdict="pass" if largest <= tolerance else "fail",
        largest_mm=largest * _MM,
    )


def accepted(entry: AcceptanceEntry | None) -> Iterator[Sentence]:
    """The verdict; nothing without a tolerance."""
    if entry is None:
        return
    if entry.verdict is None:
        yield Sentence(
            f"Not judged by the tolerance of {mm(entry.tolerance_mm)}: no poses are held out. Add "
            "`--holdout 0.3`.",
            "warn",
        )
        return
    yield Sentence(
        f"{entry.verdict.capitalize()} (tolerance {mm(entry.tolerance_mm)}): the largest error of "
        f"held-out points is {mm(entry.largest_mm)}.",
        "good" if entry.verdict == "pass" else "warn",
    )
