"""What ``posecal report`` wrote."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal

from studies.record import Record

if TYPE_CHECKING:
    from studies.document import Document


class ReportRecord(Record):
    """A page of results, which are its inputs.

    page : the file; notes : what had to be left out of it
    """

    of_one_cell: ClassVar[bool] = False
    command: Literal["report"] = "report"
    page: str
    notes: tuple[str, ...]

    def told(self) -> Document:
        from studies.report.telling import told

        return told(self)
