"""The JSON of ``posecal import``."""

from __future__ import annotations

from typing import ClassVar, Literal

from studies.results.base import Count, Result


class ImportResult(Result):
    """Points and joints as one table; markers : name -> points."""

    of_one_cell: ClassVar[bool] = False
    command: Literal["import"] = "import"
    poses: Count
    points: Count
    markers: dict[str, Count]
    columns: tuple[str, ...]
    joint_columns: tuple[str, ...] = ()
