"""The JSON of ``posecal program``."""

from __future__ import annotations

from typing import Literal

from studies.results.base import Count, Result


class ProgramResult(Result):
    """A plan as a robot program: the file, the poses by their names in it, the number of stops."""

    command: Literal["program"] = "program"
    program: str
    poses: tuple[str, ...]
    stops: Count
