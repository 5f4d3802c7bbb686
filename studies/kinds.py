"""The kinds of result that are records: a name and a type each. The names cost no import."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from studies.record import Record

KINDS = ("design", "compare", "identify", "enough", "compensate")
"""In the order in which a page tells of them."""


def record_type(kind: str) -> type[Record]:
    """The record of a kind."""
    from studies.compare.record import CompareRecord
    from studies.compensate.record import CompensateRecord
    from studies.design.record import DesignRecord
    from studies.enough.record import EnoughRecord
    from studies.identify.record import IdentifyRecord

    types: dict[str, type[Record]] = {
        "design": DesignRecord,
        "compare": CompareRecord,
        "identify": IdentifyRecord,
        "enough": EnoughRecord,
        "compensate": CompensateRecord,
    }
    return types[kind]
