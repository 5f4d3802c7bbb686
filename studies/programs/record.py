"""What ``posecal program`` wrote, and how it is told."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

from studies.day import DayEntry, day_entry
from studies.day import told as day_told
from studies.document import Document, Section, Sentence, labelled, plural
from studies.record import Count, Envelope, Record

if TYPE_CHECKING:
    from doe.day.day import PlannedDay
    from studies.programs.languages import Program, Stop


class ProgramRecord(Record):
    """A plan as a robot program: the poses by their names in it, and how often it stops at them.

    program : the file; stops : one at each pose, or one free and one loaded
    load_changes : that it waits for while the arm then moves with the load, in blocks of load
    unchecked : that poses are not checked for collisions, empty where they are
    day : the ways between the poses, and the time
    """

    command: Literal["program"] = "program"
    program: str
    poses: tuple[str, ...]
    stops: Count
    load_changes: Count
    notes: tuple[str, ...]
    unchecked: str
    day: DayEntry | None


def program_record(
    day: PlannedDay,
    stops: Sequence[Stop],
    made: Program,
    path: str,
    unchecked: str,
    made_from: Envelope,
) -> ProgramRecord:
    """The record of a program that was written to a path."""
    return ProgramRecord.from_result(
        made,
        **made_from,
        warnings=(),
        program=path,
        poses=[stop.name for stop in stops],
        stops=sum(len(stop.tasks) for stop in stops),
        load_changes=int(day.changes.sum()),
        unchecked=unchecked,
        day=day_entry(day),
    )


def told(record: ProgramRecord) -> Document:
    """The stops and the notes."""
    loaded = record.stops > len(record.poses)
    each = "free and loaded at each" if loaded else "one at each"
    said = f"{len(record.poses)} poses, {record.stops} stops to measure ({each})"
    if record.load_changes:
        changes = plural(record.load_changes, "change")
        said = f"{record.stops} stops to measure (each pose twice, with {changes} of the load)"
    day = () if record.day is None else day_told(record.day)
    parts = (Sentence(said), *day, *labelled("note", record.notes))
    unchecked = [Sentence(record.unchecked, "warn")] if record.unchecked else []
    return Document(tuple(unchecked), (Section("program", "A robot program of the plan", parts),))
