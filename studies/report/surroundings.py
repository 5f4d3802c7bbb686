"""What stands around the arm, as lines: the floor and the obstacles. Whole millimetres, base frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.cell import Cell
from calib.poses import IntArray
from calib.se3 import Array, across
from doe.constraints.obstacles import Box, HalfSpace, Obstacle, Sphere, obstacles_of

_CELLS = 5  # of the floor along the arm's length, at least
_FACE = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]], dtype=float)
_LEVEL = 1.0  # mm; a plane this close to z = 0 is the floor


@dataclass(frozen=True, eq=False)
class Outline:
    """An obstacle as lines.

    name : str; lines : tuple of ndarray of int, each of shape (k, 3), mm
    centre : ndarray of int, shape (3,), mm, where its name stands
    radius : int, mm, of a ball, whose outline is a circle from everywhere; else 0
    """

    name: str
    lines: tuple[IntArray, ...]
    centre: IntArray
    radius: int = 0


def whole_mm(metres: Array) -> IntArray:
    """Metres to whole millimetres."""
    return np.asarray(np.rint(np.asarray(metres) * 1e3), dtype=int)


def ring(radius: float) -> IntArray:
    """A level circle about the origin, shape (k, 3), mm."""
    turn = np.linspace(0.0, 2.0 * np.pi, 37)
    circle = np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], axis=1)
    return np.asarray(np.rint(radius * circle), dtype=int)


def floor_step(length: float) -> int:
    """Side of a floor cell [mm]: 1, 2 or 5 times a power of ten, for an arm of this length [mm]."""
    most = max(length / _CELLS, 1.0)
    power = 10.0 ** np.floor(np.log10(most))
    return int(max(n for n in (1, 2, 5) if n * power <= most) * power)


def floor_lines(low: IntArray, high: IntArray, step: int) -> IntArray:
    """Lines of the plane z = 0 under a box, shape (l, 2, 3), mm, those along x first."""
    first, last = low[:2] // step * step, -(-high[:2] // step) * step
    x, y = (np.arange(a, b + 1, step) for a, b in zip(first, last, strict=True))
    along_x = [[(first[0], v, 0), (last[0], v, 0)] for v in y]
    along_y = [[(v, first[1], 0), (v, last[1], 0)] for v in x]
    return np.array(along_x + along_y, dtype=int)


def outlines_of(cell: Cell, low: IntArray, high: IntArray, step: int) -> tuple[Outline, ...]:
    """The obstacles of a cell; of one without end, a patch as large as the box of the arm."""
    found = (_outline(obstacle, low, high, step) for obstacle in obstacles_of(cell))
    return tuple(outline for outline in found if outline is not None)


def _outline(obstacle: Obstacle, low: IntArray, high: IntArray, step: int) -> Outline | None:
    if isinstance(obstacle, Box):
        return _box(obstacle)
    if isinstance(obstacle, Sphere):
        centre = whole_mm(obstacle.centre)
        radius = int(np.rint(obstacle.radius * 1e3))
        return Outline(obstacle.name, (centre + ring(radius),), centre, radius)
    return _patch(obstacle, low, high, step) if isinstance(obstacle, HalfSpace) else None


def _box(box: Box) -> Outline:
    R, centre = box.T_base_box[:3, :3], box.T_base_box[:3, 3]
    faces = [np.column_stack([_FACE, np.full(5, z)]) for z in (-1.0, 1.0)]
    uprights = [
        np.stack([bottom, top]) for bottom, top in zip(faces[0][:4], faces[1][:4], strict=True)
    ]
    lines = tuple(whole_mm(centre + (line * box.half) @ R.T) for line in (*faces, *uprights))
    return Outline(box.name, lines, whole_mm(centre))


def _patch(space: HalfSpace, low: IntArray, high: IntArray, step: int) -> Outline | None:
    """A grid in the plane where it is nearest to the arm; None where it is the floor itself."""
    normal = space.normal / np.linalg.norm(space.normal)
    middle, half = (low + high) / 2.0, float((high - low).max()) / 2.0
    centre = middle + normal * (normal @ (space.point * 1e3 - middle))
    if abs(abs(normal[2]) - 1.0) < 1e-9 and abs(centre[2]) < _LEVEL:
        return None
    u, v = across(normal)
    cells = max(1, round(half / step))
    ticks = np.arange(-cells, cells + 1) * step
    ends = [
        [centre + t * a - cells * step * b, centre + t * a + cells * step * b]
        for a, b in ((u, v), (v, u))
        for t in ticks
    ]
    return Outline(space.name, tuple(np.rint(ends).astype(int)), np.rint(centre).astype(int))
