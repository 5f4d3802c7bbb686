"""The kinds of result: a folder each, with the record and how it is told. Names cost no import."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, cast

if TYPE_CHECKING:
    from studies.document import Document
    from studies.record import Record

_HOMES = {
    "fleet": ("fleet", "FleetRecord"),
    "prior": ("prior", "PriorRecord"),
    "init": ("init", "InitRecord"),
    "design": ("design", "DesignRecord"),
    "plan": ("plan", "PlanRecord"),
    "program": ("programs", "ProgramRecord"),
    "import": ("imports", "ImportRecord"),
    "compare": ("compare", "CompareRecord"),
    "identify": ("identify", "IdentifyRecord"),
    "diagnose": ("diagnose", "DiagnoseRecord"),
    "enough": ("enough", "EnoughRecord"),
    "next": ("next", "NextRecord"),
    "compensate": ("compensate", "CompensateRecord"),
    "iso9283": ("iso9283", "Iso9283Record"),
    "changes": ("changes", "ChangesRecord"),
    "report": ("report", "ReportRecord"),
    "demo": ("demo", "DemoRecord"),
}
KINDS = tuple(_HOMES)
"""In the order in which a page tells of them."""


def record_type(kind: str) -> type[Record]:
    """The record of a kind."""
    folder, name = _HOMES[kind]
    return cast("type[Record]", getattr(import_module(f"studies.{folder}.record"), name))


def tell(record: Record) -> Document:
    """What the terminal and the page say of a result."""
    folder, _ = _HOMES[record.kind]
    return cast("Document", import_module(f"studies.{folder}.telling").told(record))
