"""What ``posecal program`` wrote."""

from __future__ import annotations

from typing import Literal

from studies.record import Count, Record


class ProgramRecord(Record):
    """A plan as a robot program: the poses by their names in it, and how often it stops at them.

    program : the file; stops : one at each pose, or one free and one loaded
    unchecked : that poses are not checked for collisions, empty where they are
    """

    command: Literal["program"] = "program"
    program: str
    poses: tuple[str, ...]
    stops: Count
    notes: tuple[str, ...]
    unchecked: str = ""
