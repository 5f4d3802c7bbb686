"""Axis values as KUKA controllers write them: ``P001 {A1 10.0, A2 -90.0, ..}``.

Values of A1 to A6 are degrees; external axes turn or slide, so that E1 to E6 carry no unit.
"""

from __future__ import annotations

import re
from pathlib import Path

from calib.files.exports.sheet import Sheet, made_sheet

_AXIS = re.compile(r"([AE][1-6])\s+([+-]?[\d.]+(?:[eE][+-]?\d+)?)", re.ASCII)
_LIST = rf"\{{?\s*{_AXIS.pattern}(?:\s*,\s*{_AXIS.pattern})*\s*\}}?"
_LINE = re.compile(rf"(?:DECL\s+)?(?:GLOBAL\s+)?(?:E6AXIS\s+|AXIS\s+)?(.*?)[\s=:;,]*({_LIST})")


def axis_sheet(path: Path, lines: list[tuple[int, str]]) -> Sheet | None:
    """The list as a sheet with a header, None where a line is of another kind. Raises InputError."""
    rows: list[list[str]] = []
    axes: list[str] | None = None
    for _, line in lines:
        match = _LINE.fullmatch(line)
        if match is None:
            return None
        pairs = _AXIS.findall(match[2])
        axes = axes or [axis for axis, _ in pairs]
        if [axis for axis, _ in pairs] != axes:
            return None
        rows.append([match[1], *(value for _, value in pairs)])
    if axes is None:
        return None
    named = any(row[0] for row in rows)
    titles = [f"{axis}_deg" if axis[0] == "A" else axis for axis in axes]
    header = ["pose", *titles] if named else titles
    rows = rows if named else [row[1:] for row in rows]
    numbers = [number for number, _ in lines]
    return made_sheet(path, [], [header, *rows], [numbers[0], *numbers], ",")
