"""Rigid bodies as motion capture exports them: OptiTrack's Motive, Vicon's Tracker and Nexus, as CSV.

A row is a frame; empty fields are bodies that it did not see.
"""

from __future__ import annotations

import csv
from pathlib import Path

from calib.errors import InputError
from calib.files.exports.bodies import NAMES, WRITTEN, pose_texts
from calib.files.exports.motive import motive_layout
from calib.files.exports.points import MeasuredPoint, PointList
from calib.files.exports.recording import Row, body_frame
from calib.files.exports.sheet import text_lines
from calib.files.exports.vicon import SECTIONS, vicon_layout

_VECTOR_NOTE = (
    "RX, RY, RZ are read as rotation vectors (helical); where the export was set to Euler angles, "
    "export quaternions instead"
)


def is_motion_capture(path: Path) -> bool:
    """Whether a file holds what one of these programs' exports do. Raises InputError."""
    lines = [line.strip('",; ').lower() for _, line in text_lines(path)]
    return _of_motive("".join(lines[:1])) or any(line in SECTIONS for line in lines)


def _of_motive(line: str) -> bool:
    return line.lower().startswith("format version")


def read_motion_capture(path: Path, body: str | None) -> PointList:
    """The bodies of every frame.

    body : the name in the cell of the only body, in place of its own

    Raises InputError.
    """
    lines = text_lines(path)
    mark = max(",;", key=lambda m: sum(line.count(m) for _, line in lines[:8]))
    rows: list[Row] = [(number, _fields(path, number, line, mark)) for number, line in lines]
    layout = (motive_layout if _of_motive(rows[0][1][0]) else vicon_layout)(path, rows)
    bodies = layout.bodies
    if body is not None and len(bodies) > 1:
        known = ", ".join(own.name for own in bodies[:5])
        raise InputError(path, "", f"holds {len(bodies)} bodies, {known}", "leave --marker out")
    points: list[MeasuredPoint] = []
    for row in rows[layout.first :]:
        if not row[1][0].isdigit():
            break  # the next section
        for own in bodies:
            T = body_frame(path, row, own, layout, mark == ",")
            if T is not None:
                name = body or own.name
                points.append(MeasuredPoint(row[0], "", row[1][0], name, pose_texts(T), "", ""))
    if not points:
        raise InputError(path, "", "holds no frame that saw a body", "export a range that does")
    notes = (f"{path}: {_VECTOR_NOTE}",) if len(bodies[0].rotation) == 3 else ()
    columns = ("frame", "body", "position", "rotation")
    stated = "stated in the file"
    return PointList(
        path, points, columns, layout.unit, stated, (), WRITTEN, NAMES, frames=True, notes=notes
    )


def _fields(path: Path, number: int, line: str, mark: str) -> list[str]:
    try:
        return [field.strip() for field in next(csv.reader([line], delimiter=mark, strict=True))]
    except (csv.Error, StopIteration):
        raise InputError(path, f"line {number}", "cannot be split", "export it again") from None
