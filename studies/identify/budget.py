"""How sure a point at a target is, and whether held-out points are within the tolerance."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from studies import document as doc
from studies.document import STD, WHOLE, Mood, Rule, Sentence, Shown, labelled, listed, mm, plural
from studies.record import OWN_UNIT, Count, Entry, From, Judgement, Maybe, NotNegative, Positive

if TYPE_CHECKING:
    from calib.uncertainty.acceptance import ConformityTest
    from calib.uncertainty.budget import Budget
    from calib.uncertainty.budget import UncertaintySource as Source


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
    from calib.uncertainty.expanded import LEVEL

    total = _expanded(budget, budget.parts)
    return BudgetEntry(
        rows=tuple(_row(budget, part, total.standard_uncertainty_mm**2) for part in budget.parts),
        calibration=_expanded(budget, budget.calibration),
        total=total,
        probability=LEVEL,
    )


def _expanded(budget: Budget, parts: Sequence[Source]) -> ExpandedUncertainty:
    from calib.uncertainty.budget import combined

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
    at_targets, placed = (budget.rms(e) * _MM for e in (part.errors, part.errors_placed))
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


Verdict = Literal["pass", "fail", "undecided"]


class AcceptanceEntry(Entry):
    """The verdict over all held-out points, and how many of them are which; None without any.

    largest_mm : distance of any; expanded_mm : the largest uncertainty of any reading, with 95 %
    """

    tolerance_mm: Positive
    rule: Literal["simple", "guarded"]
    verdict: Verdict | None
    points: Annotated[Count, From("verdicts")]
    passed: Count
    failed: Count
    undecided: Count
    largest_mm: NotNegative
    expanded_mm: NotNegative

    @property
    def judgement(self) -> Judgement:
        """The verdict and what it rests on."""
        tolerance = f"tolerance {self.tolerance_mm:g} mm"
        if self.verdict is None:
            return Judgement("undecided", f"{tolerance}: not judged without held-out poses")
        counts = f"{self.passed} of {self.points} held-out points are within it"
        largest = f"the largest error is {self.largest_mm:.3g} mm"
        return Judgement(self.verdict, f"{tolerance}: {counts}, {largest}")

    @property
    def stated(self) -> str:
        """The decision rule."""
        if self.rule == "simple":
            return (
                "simple acceptance, no guard band: at the limit a wrong decision is as likely as a "
                "right one (JCGM 106)"
            )
        return (
            f"guard band of the readings' expanded uncertainty, up to {mm(self.expanded_mm)} with 95 % "
            "(ISO 14253-1)"
        )


def acceptance_entry(judged: ConformityTest) -> AcceptanceEntry:
    """The entry of a judgement."""
    count = judged.verdicts.count
    return AcceptanceEntry.from_result(
        judged,
        judged.acceptance,
        passed=count("pass"),
        failed=count("fail"),
        undecided=count("undecided"),
        largest_mm=judged.distances.max(initial=0.0) * _MM,
        expanded_mm=judged.expanded.max(initial=0.0) * _MM,
    )


_MOODS: dict[Verdict, tuple[str, Mood]] = {
    "pass": ("Pass", "good"),
    "fail": ("Fail", "warn"),
    "undecided": ("Undecided", "warn"),
}


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
    word, mood = _MOODS[entry.verdict]
    counts = (
        (entry.passed, "within"), (entry.failed, "beyond"), (entry.undecided, "too close to tell")
    )  # fmt: skip
    parts = ", ".join(f"{count} {where}" for count, where in counts if count)
    yield Sentence(
        f"{word} (tolerance {mm(entry.tolerance_mm)}): {parts} of "
        f"{plural(entry.points, 'held-out point')}; the largest error is {mm(entry.largest_mm)}.",
        mood,
    )
