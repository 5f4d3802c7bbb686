"""Whether the points held out are within the cell's tolerance, and by which rule."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Literal

from studies.document import Mood, Sentence, mm, plural
from studies.record import Count, Entry, NotNegative, Positive

if TYPE_CHECKING:
    from calib.uncertainty.acceptance import ConformityTest

_MM = 1e3

Verdict = Literal["pass", "fail", "undecided"]


class AcceptanceEntry(Entry):
    """The verdict over all held-out points, and how many of them are which; None without any.

    largest_mm : distance of any; expanded_mm : the largest uncertainty of any reading, with 95 %
    """

    tolerance_mm: Positive
    rule: Literal["simple", "guarded"]
    verdict: Verdict | None
    points: Count
    passed: Count
    failed: Count
    undecided: Count
    largest_mm: NotNegative
    expanded_mm: NotNegative

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
        points=len(judged.verdicts),
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
