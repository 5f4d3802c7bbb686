"""What ``posecal report`` wrote, and what that says of itself on another page."""

from __future__ import annotations

from typing import ClassVar, Literal

from studies.document import Detail, Document, Section, Sentence, labelled, plural
from studies.record import Record


class ReportRecord(Record):
    """A page of results, which are its inputs.

    page : the file; notes : what had to be left out of it
    """

    of_one_cell: ClassVar[bool] = False
    command: Literal["report"] = "report"
    page: str
    notes: tuple[str, ...]


def told(record: ReportRecord) -> Document:
    """Of how many results, and what it lacks."""
    about = Sentence(f"{record.page}: one page of {plural(len(record.inputs), 'result')}")
    parts = (about, *labelled("note", record.notes))
    return Document((), (Section("report", "A page of results", (Detail(parts),)),))
