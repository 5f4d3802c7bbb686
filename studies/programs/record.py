"""What ``posecal program`` wrote, and how it is told."""

from __future__ import annotations

from typing import Literal

from studies.document import Document, Section, Sentence, labelled
from studies.record import Count, Record


class ProgramRecord(Record):
    """A plan as a robot program: the poses by their names in it, and how often it stops at them.

    program : the file; stops : one at each pose, or one free and one loaded
    unchecked : that poses are not checked for collisions, empty where they are
    """

    command: Literal["program"] = "program"
    program: str
    poses: tuple[str, ...]
    stops: Count
    notes: tuple[str, ...]
    unchecked: str = ""


def told(record: ProgramRecord) -> Document:
    """The stops and the notes."""
    loaded = record.stops > len(record.poses)
    each = "free and loaded at each" if loaded else "one at each"
    stops = Sentence(f"{len(record.poses)} poses, {record.stops} stops to measure ({each})")
    parts = (stops, *labelled("note", record.notes))
    unchecked = [Sentence(record.unchecked, "warn")] if record.unchecked else []
    return Document(tuple(unchecked), (Section("program", "A robot program of the plan", parts),))
