"""The kinds of result that are records: a name and a type each. The names cost no import."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from studies.record import Record

KINDS = (
    "design",
    "plan",
    "compare",
    "identify",
    "diagnose",
    "enough",
    "next",
    "compensate",
    "iso9283",
    "changes",
    "fleet",
    "prior",
)
"""In the order in which a page tells of them."""


def record_type(kind: str) -> type[Record]:
    """The record of a kind."""
    from studies.changes.record import ChangesRecord
    from studies.compare.record import CompareRecord
    from studies.compensate.record import CompensateRecord
    from studies.design.record import DesignRecord
    from studies.diagnose.record import DiagnoseRecord
    from studies.enough.record import EnoughRecord
    from studies.fleet.record import FleetRecord
    from studies.identify.record import IdentifyRecord
    from studies.iso9283.record import Iso9283Record
    from studies.next.record import NextRecord
    from studies.plan.record import PlanRecord
    from studies.prior.record import PriorRecord

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
    }
    return types[kind]
