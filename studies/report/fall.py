"""By how much the error fell, by one result of each kind that says so."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from statistics import median
from typing import Any, Literal

from studies.changes.record import ChangesRecord
from studies.compensate.record import CompensateRecord
from studies.diagnose.record import DiagnoseRecord
from studies.enough.record import EnoughRecord
from studies.fleet.record import FleetRecord
from studies.identify.acceptance import AcceptanceEntry
from studies.identify.record import IdentifyRecord
from studies.record import Record

Outcome = Literal["pass", "fail", "undecided"]


@dataclass(frozen=True)
class Fall:
    """An error before and after.

    of : which error; before, after : in the unit
    outcome : by the tolerance, None where none is given; judged : by which, and why
    word : for the outcome, where it is not its name; ends : what before and after are called
    """

    of: str
    before: float
    after: float
    unit: str = "mm"
    outcome: Outcome | None = None
    judged: str = ""
    word: str = ""
    ends: tuple[str, str] = ("before", "after")


def fall(record: Record) -> Fall | None:
    """What a result says, None where it holds no error before and after."""
    tell = _OF.get(type(record))
    return None if tell is None else tell(record)


def _identified(record: IdentifyRecord) -> Fall:
    """Of lengths; where no reading is one, of the instrument that is predicted worst."""
    before, after, unit, heldout = record.error
    where = "held-out poses" if heldout else "the fitted poses"
    return Fall(f"RMS error at {where}", before, after, unit, *_accepted(record.acceptance))


def _accepted(entry: AcceptanceEntry | None) -> tuple[Outcome | None, str]:
    if entry is None:
        return None, ""
    tolerance = f"tolerance {entry.tolerance_mm:g} mm"
    if entry.verdict is None:
        return "undecided", f"{tolerance}: not judged without held-out poses"
    counts = f"{entry.passed} of {entry.points} held-out points are within it"
    return entry.verdict, f"{tolerance}: {counts}, the largest error is {entry.largest_mm:.3g} mm"


def _diagnosed(record: DiagnoseRecord) -> Fall:
    before, after, unit, heldout = record.error
    where = "held-out poses" if heldout else "the fitted poses"
    of = f"RMS error at {where}, with the model as given and with the causes found"
    return Fall(of, before, after, unit)


def _compensated(record: CompensateRecord) -> Fall:
    rms = record.rms_mm
    return Fall("RMS error at the targets, expected after correction", rms.before, rms.expected)


def _changed(record: ChangesRecord) -> Fall:
    outcomes: dict[str, Outcome] = {
        "holds": "pass", "does_not": "fail", "cannot_be_said": "undecided"
    }  # fmt: skip
    ends = (f"with {record.before}", f"with {record.after}")
    errors = record.kept_rms_mm.value, record.renewed_rms_mm
    found = Fall("RMS error at the targets today", *errors, ends=ends)
    if record.tolerance_mm is None or record.verdict is None:
        return found
    judged = f"tolerance {record.tolerance_mm:g} mm at any target, with {record.before}"
    return replace(found, outcome=outcomes[record.verdict], judged=judged)


def _measured(record: EnoughRecord) -> Fall | None:
    now, end = record.now.task_rms_mm, record.end.task_rms_mm
    if now is None or end is None:
        return None
    ends = ("now", "after all planned poses")
    found = Fall("RMS error expected at the targets", now, end, ends=ends)
    if record.goal_mm is None:
        return found
    goal = f"goal {record.goal_mm:g} mm"
    if record.poses_to_goal == 0:
        return replace(found, outcome="pass", judged=goal, word="Enough")
    return replace(found, outcome="fail", judged=goal, word="Not enough yet")


def _of_fleet(record: FleetRecord) -> Fall | None:
    last = {own.robot: own.rms_mm for own in record.sessions if own.status}
    held = all(own.heldout is not None for own in last.values())
    before = [own.nominal for own in last.values() if own.nominal is not None]
    after = [own.heldout if held else own.fitted for own in last.values()]
    if not before or None in after:
        return None
    where = "held-out poses" if held else "the fitted poses"
    of = f"RMS error at {where}, median of {len(last)} robots"
    return Fall(of, median(before), median(own for own in after if own is not None))


_OF: dict[type[Record], Callable[[Any], Fall | None]] = {
    IdentifyRecord: _identified,
    CompensateRecord: _compensated,
    DiagnoseRecord: _diagnosed,
    ChangesRecord: _changed,
    FleetRecord: _of_fleet,
    EnoughRecord: _measured,
}
FALLING = ("fleet", "identify", "compensate", "diagnose", "changes", "enough")
"""Kinds of results that say so, what a reader asks for first."""
