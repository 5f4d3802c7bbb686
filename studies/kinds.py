"""The kinds of result: where the record of each is, and how it is told. Names cost no import."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, cast

if TYPE_CHECKING:
    from studies.document import Document
    from studies.record import Record

_HOMES = {
    "init": ("init.record", "InitRecord", "init.record"),
    "design": ("design.record", "DesignRecord", "design.telling"),
    "plan": ("plan.record", "PlanRecord", "plan.telling"),
    "program": ("programs.record", "ProgramRecord", "programs.record"),
    "import": ("imports.record", "ImportRecord", "imports.record"),
    "compare": ("compare.record", "CompareRecord", "compare.telling"),
    "identify": ("results.identify", "IdentifyResult", ""),
    "diagnose": ("results.diagnose", "DiagnoseResult", ""),
    "enough": ("enough.record", "EnoughRecord", "enough.telling"),
    "compensate": ("compensate.record", "CompensateRecord", "compensate.record"),
    "changes": ("changes.record", "ChangesRecord", "changes.record"),
    "report": ("results.report", "ReportResult", ""),
    "demo": ("demo.record", "DemoRecord", "demo.record"),
}
"""Kind -> module of the record, its name, and module of :func:`told`."""
KINDS = tuple(_HOMES)
"""In the order in which a page tells of them."""


def record_type(kind: str) -> type[Record]:
    """The record of a kind."""
    module, name, _ = _HOMES[kind]
    return cast("type[Record]", getattr(import_module(f"studies.{module}"), name))


def tell(record: Record) -> Document:
    """What the terminal and the page say of a result."""
    module = _HOMES[record.kind][2]
    return cast("Document", import_module(f"studies.{module}").told(record))
