"""What a page says of itself on another page; the terminal only hears where it is."""

from __future__ import annotations

from studies.document import Detail, Document, Section, Sentence, labelled, plural
from studies.report.record import ReportRecord


def told(record: ReportRecord) -> Document:
    """Of how many results, and what it lacks."""
    about = Sentence(f"{record.page}: one page of {plural(len(record.inputs), 'result')}")
    parts = (about, *labelled("note", record.notes))
    return Document((), (Section("report", "A page of results", (Detail(parts),)),))
