"""The kinds of result that are records: a name and a type each. The names cost no import."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from studies.record import Record

KINDS = (
    "fleet",
    "prior",
    "init",
    "design",
    "plan",
    "program",
    "import",
    "compare",
    "identify",
    "diagnose",
    "enough",
    "next",
    "compensate",
    "iso9283",
    "changes",
    "report",
    "demo",
)
"""In the order in which a page tells of them."""


def record_type(kind: str) -> type[Record]:
    """The record of a kind."""
    from studies.changes.record import ChangesRecord
    from studies.compare.record import CompareRecord
    from studies.compensate.record import CompensateRecord
    from studies.demo.record import DemoRecord
    from studies.design.record import DesignRecord
    from studies.diagnose.record import DiagnoseRecord
    from studies.enough.record import EnoughRecord
    from studies.fleet.record import FleetRecord
    from studies.identify.record import IdentifyRecord
    from studies.imports.record import ImportRecord
    from studies.init.record import InitRecord
    from studies.iso9283.record import Iso9283Record
    from studies.next.record import NextRecord
    from studies.plan.record import PlanRecord
    from studies.prior.record import PriorRecord
    from studies.programs.record import ProgramRecord
    from studies.report.record import ReportRecord

    types: dict[str, type[Record]] = {
        "design": DesignRecord,
        "plan": PlanRecord,
        "compare": CompareRecord,
        "identify": IdentifyRecord,
        "diagnose": DiagnoseRecord,
        "enough": EnoughRecord,
        "compensate": CompensateRecord,
        "iso9283": Iso9283Record,
        "fleet": FleetRecord,
        "changes": ChangesRecord,
        "prior": PriorRecord,
        "next": NextRecord,
        "init": InitRecord,
        "program": ProgramRecord,
        "import": ImportRecord,
        "report": ReportRecord,
        "demo": DemoRecord,
    }
    return types[kind]
