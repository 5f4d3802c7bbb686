"""By how much the error fell, by one result of each kind that says so."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from studies.changes.record import ChangesRecord
from studies.enough.record import EnoughRecord
from studies.fleet.record import FleetRecord
from studies.identify.record import IdentifyRecord
from studies.record import BeforeAfter, Record

Outcome = Literal["pass", "fail", "undecided"]

_OF = {
    "fleet": "RMS error at {where}, median of {robots} robots",
    "identify": "RMS error at {where}",
    "compensate": "RMS error at the targets, expected after correction",
    "diagnose": "RMS error at {where}, with the model as given and with the causes found",
    "changes": "RMS error at the targets today",
    "enough": "RMS error expected at the targets",
}
FALLING = tuple(_OF)
"""Kinds of results with an error before and after, what a reader asks for first."""


@dataclass(frozen=True)
class Judgement:
    """What a tolerance makes of an error; word : for the outcome, where it is not its name."""

    outcome: Outcome
    by: str
    word: str = ""


@dataclass(frozen=True)
class Fall:
    """An error before and after in words.

    of : which error; ends : what before and after are called; judged : None without a tolerance
    """

    of: str
    error: BeforeAfter
    ends: tuple[str, str] = ("before", "after")
    judged: Judgement | None = None


def fall(record: Record) -> Fall | None:
    """What a result says, None where it holds no error before and after."""
    error = record.error
    if error is None:
        return None
    robots = len(record.latest) if isinstance(record, FleetRecord) else 0
    where = "held-out poses" if error.heldout else "the fitted poses"
    of = _OF[record.kind].format(where=where, robots=robots)
    return Fall(of, error, _ends(record), _judged(record))


def _ends(record: Record) -> tuple[str, str]:
    if isinstance(record, ChangesRecord):
        return f"with {record.before}", f"with {record.after}"
    if isinstance(record, EnoughRecord):
        return "now", "after all planned poses"
    return "before", "after"


def _judged(record: Record) -> Judgement | None:
    if isinstance(record, IdentifyRecord) and record.acceptance is not None:
        own = record.acceptance
        tolerance = f"tolerance {own.tolerance_mm:g} mm"
        if own.verdict is None:
            return Judgement("undecided", f"{tolerance}: not judged without held-out poses")
        counts = f"{own.passed} of {own.points} held-out points are within it"
        largest = f"the largest error is {own.largest_mm:.3g} mm"
        return Judgement(own.verdict, f"{tolerance}: {counts}, {largest}")
    if isinstance(record, ChangesRecord) and record.verdict is not None:
        outcomes: dict[str, Outcome] = {
            "holds": "pass", "does_not": "fail", "cannot_be_said": "undecided"
        }  # fmt: skip
        by = f"tolerance {record.tolerance_mm:g} mm at any target, with {record.before}"
        return Judgement(outcomes[record.verdict], by)
    if isinstance(record, EnoughRecord) and record.goal_mm is not None:
        goal = f"goal {record.goal_mm:g} mm"
        if record.poses_to_goal == 0:
            return Judgement("pass", goal, "Enough")
        return Judgement("fail", goal, "Not enough yet")
    return None
