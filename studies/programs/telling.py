"""What a program says: where it stops, and what to know of it."""

from __future__ import annotations

from studies.document import Document, Section, Sentence, labelled
from studies.programs.record import ProgramRecord


def told(record: ProgramRecord) -> Document:
    """The stops and the notes."""
    loaded = record.stops > len(record.poses)
    each = "free and loaded at each" if loaded else "one at each"
    stops = Sentence(f"{len(record.poses)} poses, {record.stops} stops to measure ({each})")
    parts = (stops, *labelled("note", record.notes))
    unchecked = [Sentence(record.unchecked, "warn")] if record.unchecked else []
    return Document(tuple(unchecked), (Section("program", "A robot program of the plan", parts),))
