"""``report --json``: which page was written of which results."""

from __future__ import annotations

from typing import ClassVar, Literal

from studies.results.base import Result


class ReportResult(Result):
    """A page of results, which are its inputs.

    page : the file; notes : what had to be left out of it
    """

    of_one_cell: ClassVar[bool] = False
    command: Literal["report"] = "report"
    page: str
    notes: tuple[str, ...]
