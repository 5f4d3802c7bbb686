"""What programs of motion capture have in common: rows are frames, columns places and rotations."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.arm.se3 import so3_exp
from calib.arrays import Array
from calib.errors import InputError
from calib.files.exports.bodies import OFF_UNIT, frame_of

METRES = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254, "ft": 0.3048}
RADIANS = {"deg": math.pi / 180.0, "rad": 1.0}
_TURN = 2.0 * math.pi
Row = tuple[int, list[str]]
"""A line's number and its fields."""


@dataclass(frozen=True)
class Body:
    """A body's name, and the columns of its rotation (x, y, z and maybe w) and of its place."""

    name: str
    rotation: tuple[int, ...]
    place: tuple[int, ...]


@dataclass(frozen=True)
class Layout:
    """The bodies of a file, its first row of numbers, and the units in which they are."""

    bodies: list[Body]
    first: int
    unit: str
    angle: str = "rad"


def body_frame(path: Path, row: Row, body: Body, layout: Layout, pointed: bool) -> Array | None:
    """The frame (4, 4), m, of a body in a row; None where it was not seen.

    pointed : whether decimals follow a point, not a comma

    Raises InputError.
    """
    line, fields = f"line {row[0]}", row[1]
    texts = [fields[k] if k < len(fields) else "" for k in (*body.rotation, *body.place)]
    if not any(texts):
        return None
    numbers = [_number(text if pointed else text.replace(",", ".")) for text in texts]
    for text, number in zip(texts, numbers, strict=True):
        if not math.isfinite(number):
            what = f"{text[:40]!r} of {body.name} is no number"
            raise InputError(path, line, what, "export it again")
    turn = numbers[: len(body.rotation)]
    place = [METRES[layout.unit] * v for v in numbers[len(body.rotation) :]]
    if len(turn) == 3:
        vector = np.array(turn) * RADIANS[layout.angle]
        if np.linalg.norm(vector) > _TURN:
            what = f"{body.name} turns by more than a whole turn: no rotation vector"
            raise InputError(path, line, what, "export quaternions")
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = so3_exp(vector), place
        return T
    if not abs(math.hypot(*turn) - 1.0) < OFF_UNIT:
        what = f"the quaternion of {body.name} has a length of {math.hypot(*turn):.4g}"
        raise InputError(path, line, what, "export it again")
    x, y, z, w = turn
    return frame_of(place, [w, x, y, z])


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan
