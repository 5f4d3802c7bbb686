"""The page: sections in a frame, styles and scripts within it; and its record."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import ClassVar, Literal

from markupsafe import Markup

from studies.document import Detail, Document, Section, Sentence, labelled, plural
from studies.document.page import Writer, template
from studies.record import Record
from studies.report.evidence import load_evidence
from studies.report.sections import sections


def asset(name: str) -> Markup:
    """The text of a file, to stand inside ``<style>`` or ``<script>``."""
    return Markup((files("studies.report") / name).read_text(encoding="utf-8"))  # noqa: S704


_STYLES = ("page.css", "highlight.css", "arm_view.css")
_SCRIPTS = ("page.js", "arm_view.js")


def report_page(
    results: Sequence[Path], title: str | None, told: dict[str, str]
) -> tuple[str, tuple[str, ...]]:
    """The report as HTML that names nothing outside itself, and notes on what had to be left out.

    title : str, None for the name of the cell
    told : what the user tells of the measurement (operator, instrument ..), by label

    Raises InputError where a file is no result, or one that misses what results of its kind hold.
    """
    evidence, writer = load_evidence(results), Writer.fresh()
    named = [own.record.cell for own in evidence.results if own.record.cell] or ["Calibration"]
    name = named[0] if evidence.cell is None else evidence.cell.name
    html = template("studies.report", "page.html.j2").render(
        title=title or name,
        told=told,
        sections=[(own, writer.section(own, poses)) for own, poses in sections(evidence, told)],
        styles=[asset(name) for name in _STYLES],
        scripts=[asset(name) for name in _SCRIPTS],
    )
    return html, evidence.notes


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
