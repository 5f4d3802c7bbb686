"""Rigid bodies as motion capture exports them: OptiTrack's Motive, Vicon's Tracker and Nexus, as CSV.

A row is a frame; empty fields are bodies that it did not see. Motive's first line says how it writes,
titles stand in columns. Vicon has a section ``Segments`` or ``Objects``: RX, RY, RZ are a rotation
vector, with RW a quaternion, and TX, TY, TZ the place; units stand below the titles, names above them.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.arm.se3 import so3_exp, transform
from calib.arrays import Array
from calib.errors import InputError
from calib.files.exports.points import PointList, body_list, quaternion_frame
from calib.files.exports.sheet import text_lines

METRES = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254, "ft": 0.3048}
RADIANS = {"deg": math.pi / 180.0, "rad": 1.0}
Row = tuple[int, list[str]]
"""A line's number and its fields."""


@dataclass(frozen=True)
class RigidBody:
    """A body's name, and the columns of its rotation (x, y, z and maybe w) and of its place."""

    name: str
    rotation: tuple[int, ...]
    place: tuple[int, ...]


@dataclass(frozen=True)
class Layout:
    """The bodies of a file, its first row of numbers, and the units in which they are."""

    bodies: list[RigidBody]
    first: int
    unit: str
    angle: str = "rad"


def _frame(path: Path, row: Row, body: RigidBody, layout: Layout, pointed: bool) -> Array | None:
    """The frame (4, 4), m, of a body in a row; None where it was not seen.

    pointed : whether decimals follow a point, not a comma

    Raises InputError.
    """
    line, fields = f"line {row[0]}", row[1]
    texts = [fields[k] if k < len(fields) else "" for k in (*body.rotation, *body.place)]
    if not any(texts):
        return None
    numbers = []
    for text in texts:
        try:
            numbers.append(float(text if pointed else text.replace(",", ".")))
        except ValueError:
            numbers.append(math.nan)
        if not math.isfinite(numbers[-1]):
            what = f"{text[:40]!r} of {body.name} is no number"
            raise InputError(path, line, what, "export it again")
    turn = numbers[: len(body.rotation)]
    place = [METRES[layout.unit] * v for v in numbers[len(body.rotation) :]]
    if len(turn) == 3:
        vector = np.array(turn) * RADIANS[layout.angle]
        if np.linalg.norm(vector) > 2.0 * math.pi:
            what = f"{body.name} turns by more than a whole turn: no rotation vector"
            raise InputError(path, line, what, "export quaternions")
        return transform(so3_exp(vector), np.array(place))
    found = quaternion_frame(place, turn)
    if found is None:
        what = f"the quaternion of {body.name} has a length of {math.hypot(*turn):.4g}"
        raise InputError(path, line, what, "export it again")
    return found


_UNITS = {
    "millimeters": "mm", "centimeters": "cm", "meters": "m", "inches": "in", "feet": "ft",
}  # fmt: skip


def motive_layout(path: Path, rows: list[Row]) -> Layout:
    """Where the bodies of Motive stand. Raises InputError for another rotation, space or unit."""
    unit = _unit(path, rows[0][1])
    titles = next((k for k, (_, row) in enumerate(rows) if row[0].lower() == "frame"), 0)
    label = {row[1].lower(): row for _, row in rows[:titles] if len(row) > 1 and row[1]}
    if titles < 3 or not {"type", "name"} <= label.keys():
        raise InputError(path, "", "has no header of types and names", "export with its header")
    kinds, names = label["type"], label["name"]
    quantities, axes = rows[titles - 1][1], rows[titles][1]
    columns: dict[str, dict[tuple[str, str], int]] = {}
    for k, (kind, name, quantity, axis) in enumerate(
        zip(kinds, names, quantities, axes, strict=False)
    ):
        if kind.lower() == "rigid body":
            columns.setdefault(name, {}).setdefault((quantity.lower(), axis.lower()), k)
    found = []
    for name, own in columns.items():
        wanted = [("rotation", axis) for axis in "xyzw"], [("position", axis) for axis in "xyz"]
        if not {*wanted[0], *wanted[1]} <= own.keys():
            what = "has not all of rotation X Y Z W and position X Y Z"
            raise InputError(path, f"body {name}", what)
        found.append(RigidBody(name, *(tuple(own[key] for key in keys) for keys in wanted)))
    if not found:
        raise InputError(path, "", "holds no rigid body", "export with Rigid Bodies")
    return Layout(found, titles + 1, unit)


def _unit(path: Path, head: list[str]) -> str:
    """The unit of length that the first line states. Raises InputError for what is not read."""
    said = {k.lower(): v.lower() for k, v in zip(head[::2], head[1::2], strict=False)}
    if said.get("rotation type") != "quaternion":
        what = f"has the rotation type {said.get('rotation type', '')[:20]!r}"
        raise InputError(path, "line 1", what, "export with rotation type Quaternion")
    if said.get("coordinate space", "global") != "global":
        what = f"has {said['coordinate space'][:20]} coordinates"
        raise InputError(path, "line 1", what, "export in global coordinate space")
    unit = _UNITS.get(said.get("length units", ""), "")
    if not unit:
        what = f"states no known unit of length ({said.get('length units', '')[:20]!r})"
        raise InputError(path, "line 1", what, "export in Meters or Millimeters")
    return unit


def vicon_layout(path: Path, rows: list[Row]) -> Layout:
    """Where the segments of Vicon stand. Raises InputError for other columns, and for no units."""
    section = next((k for k, (_, row) in enumerate(rows) if row[0].lower() in SECTIONS), 0)
    below = range(section, len(rows))
    titles = next((k for k in below if rows[k][1][0].lower() == "frame"), 0)
    head = [title.upper() for title in rows[titles][1]]
    if titles < 1 or "RX" not in head or len(rows) < titles + 2:
        what = "has no columns Frame, Sub Frame, RX, RY, RZ, TX, TY, TZ"
        raise InputError(path, "", what, "export the segments, or objects")
    names, units = rows[titles - 1][1], [unit.lower() for unit in rows[titles + 1][1]]
    wanted = ("RX", "RY", "RZ", "RW", "TX", "TY", "TZ") if "RW" in head else _SIX
    found: list[RigidBody] = []
    for k in (k for k, title in enumerate(head) if title == "RX"):
        part = tuple(head[k : k + len(wanted)])
        if part != wanted:
            what = f"has the columns {' '.join(part)}, where {' '.join(wanted)} are read"
            line = f"line {rows[titles][0]}"
            raise InputError(path, line, what, "export the segments, or objects")
        name = names[k] if k < len(names) and names[k] else f"body{len(found) + 1}"
        columns = tuple(range(k, k + len(wanted)))
        # An object is a subject with one segment of the same name.
        subject, _, segment = name.partition(":")
        name = subject if subject == segment else name
        found.append(RigidBody(name, columns[:-3], columns[-3:]))
    angle = _unit_of(path, rows[titles + 1][0], units, found, "rotation")
    unit = _unit_of(path, rows[titles + 1][0], units, found, "place")
    return Layout(found, titles + 2, unit, angle or "rad")


SECTIONS = ("segments", "objects")
_SIX = ("RX", "RY", "RZ", "TX", "TY", "TZ")


def _unit_of(
    path: Path, line: int, units: list[str], bodies: Sequence[RigidBody], part: str
) -> str:
    """The one unit of all columns of a part. Raises InputError."""
    known = RADIANS if part == "rotation" else METRES
    quaternion = part == "rotation" and len(bodies[0].rotation) == 4
    found = {units[k] if k < len(units) else "" for own in bodies for k in getattr(own, part)}
    if len(found) == 1 and (quaternion or found <= known.keys()):
        return found.pop()
    what = f"states no one unit of the {part} ({', '.join(sorted(found))[:40]!r})"
    raise InputError(path, f"line {line}", what, f"export in {' or '.join(known)}")


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
    read = []
    for row in rows[layout.first :]:
        if not row[1][0].isdigit():
            break  # the next section
        for own in bodies:
            T = _frame(path, row, own, layout, mark == ",")
            if T is not None:
                read.append((row[0], row[1][0], body or own.name, T))
    if not read:
        raise InputError(path, "", "holds no frame that saw a body", "export a range that does")
    note = _VECTOR_NOTE if len(bodies[0].rotation) == 3 else ""
    columns, unit = ("frame", "body", "position", "rotation"), (layout.unit, "stated in the file")
    return body_list(path, read, columns, unit, note, frames=True)


def _fields(path: Path, number: int, line: str, mark: str) -> list[str]:
    try:
        return [field.strip() for field in next(csv.reader([line], delimiter=mark, strict=True))]
    except (csv.Error, StopIteration):
        raise InputError(path, f"line {number}", "cannot be split", "export it again") from None
