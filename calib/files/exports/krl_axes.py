"""Axis values as KUKA controllers write them: ``P001 {A1 10.0, A2 -90.0, ..}``.

Values of A1 to A6 are degrees; external axes turn or slide, so that E1 to E6 carry no unit.
"""

from __future__ import annotations

import re
from pathlib import Path

from calib.files.exports.sheet import Sheet, made_sheet

_AXIS = re.compile(r"([AE][1-6])\s+([+-]?[\d.]+(?:[eE][+-]?\d+)?)", re.ASCII)
_LIST = rf"\{{?\s*{_AXIS.pattern}(?:\s*,\s*{_AXIS.pattern})*\s*\}}?"
_LISTED = re.compile(_LIST)
_DECLARED = re.compile(r"(?:DECL\s+)?(?:GLOBAL\s+)?(?:E6AXIS\s+|AXIS\s+)?")
_AFTER_NAME = " \t=:;,"


def axis_sheet(path: Path, lines: list[tuple[int, str]]) -> Sheet | None:
    """The list as a sheet with a header, None where a line is of another kind. Raises InputError."""
    rows: list[list[str]] = []
    axes: list[str] | None = None
    for _, line in lines:
        start = _start(line)
        if _LISTED.fullmatch(line, start) is None:
            return None
        pairs = _AXIS.findall(line, start)
        axes = axes or [axis for axis, _ in pairs]
        if [axis for axis, _ in pairs] != axes:
            return None
        name = _DECLARED.sub("", line[:start], count=1).rstrip(_AFTER_NAME)
        rows.append([name, *(value for _, value in pairs)])
    if axes is None:
        return None
    named = any(row[0] for row in rows)
    titles = [f"{axis}_deg" if axis[0] == "A" else axis for axis in axes]
    header = ["pose", *titles] if named else titles
    rows = rows if named else [row[1:] for row in rows]
    numbers = [number for number, _ in lines]
    return made_sheet(path, [], [header, *rows], [numbers[0], *numbers], ",")


def _start(line: str) -> int:
    """Where the list begins, the end of the line where there is none. Takes linear time."""
    brace = line.find("{")
    if brace >= 0:
        return brace
    first = _AXIS.search(line)
    return len(line) if first is None else first.start()
