"""What stands around the arm, as lines: floor, obstacles, instrument. Whole millimetres, base frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.arm.se3 import across
from calib.arrays import Array, IntArray
from calib.cell import Cell
from calib.cell.planned import Ball, Box, HalfSpace
from doe.constraints.obstacles import Obstacle, obstacles_of

_FLAT = 1e-6  # of the size
_TURN = np.linspace(0.0, 2.0 * np.pi, 37)
_CELLS = 5  # of the floor along the arm's length, at least
_NEAR = 1.6  # arm lengths; what stands farther from the middle is not in the picture
_FOOT = 0.09  # arm lengths
_FACE = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]], dtype=float)
_LEVEL = 1.0  # mm; a plane this close to z = 0 is the floor


def hull_runs(points: Array) -> list[list[int]]:
    """Points (n, 3) by their numbers, one after the other along the edges of their hull.

    Of points in a plane the one closed line around them, of points on a line that line.
    """
    from scipy.spatial import ConvexHull

    _, size, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    spread = int((size > _FLAT * max(float(size[0]), _FLAT)).sum())
    flat = points @ axes[:spread].T
    if len(points) <= spread or spread < 2:
        return [np.argsort(flat[:, 0]).tolist()] if spread else [list(range(len(points)))]
    hull = ConvexHull(flat)
    if spread == 2:
        return [[*hull.vertices.tolist(), int(hull.vertices[0])]]
    edges: dict[frozenset[int], list[Array]] = {}
    for face, plane in zip(hull.simplices.tolist(), hull.equations, strict=True):
        for a, b in ((0, 1), (1, 2), (2, 0)):
            edges.setdefault(frozenset((face[a], face[b])), []).append(plane[:3])
    sharp = (edge for edge, (one, other) in edges.items() if one @ other < 1.0 - _FLAT)
    return [sorted(edge) for edge in sharp]


def ring(centre: Array, radius: float) -> Array:
    """A level circle (k, 3)."""
    circle = np.stack([np.cos(_TURN), np.sin(_TURN), 0.0 * _TURN], axis=1)
    return np.asarray(centre + radius * circle)


def grid_lines(middle: Array, u: Array, v: Array, half: float, step: float) -> list[Array]:
    """Lines (2, 3) of a square grid about a point, along u and v, so far to each side."""
    return [
        np.stack([middle + t * a - half * b, middle + t * a + half * b])
        for a, b in ((u, v), (v, u))
        for t in np.arange(-half, half + step / 2.0, step)
    ]


@dataclass(frozen=True, eq=False)
class SceneObject:
    """An obstacle, an instrument or what it reads, as lines and dots.

    Points are (m, k, 3), or (k, 3) where they stand still, m.

    kind : str, after which its class in the drawing is called
    lines : sequence of ndarray; dots : ndarray, n points
    label : ndarray, one point, where words stand; radius : float, m, of the dots, or 0
    words : what is written there: its name, or of what stands close together one for all
    stem : ndarray or None, shape (m, 1, 3), the tip that carries it; None for what stands in the world
    """

    kind: str
    name: str
    lines: Sequence[Array]
    dots: Array
    label: Array
    words: str
    radius: float = 0.0
    stem: Array | None = None

    @property
    def points(self) -> Array:
        """All of them, lines, dots, the place of the name, at all poses, (k, 3)."""
        return np.concatenate([p.reshape(-1, 3) for p in (*self.lines, self.dots, self.label)])


NO_POINTS = np.zeros((0, 3))


@dataclass(frozen=True, eq=False)
class ArmSurroundings:
    """All that does not move, and what the picture must show.

    floor : ndarray of int, shape (l, 2, 3), lines of the plane z = 0, ``step`` mm apart
    foot : ndarray of int, shape (k, 3), a ring on the floor around the base
    obstacles : tuple of SceneObject
    instrument : ndarray of int, shape (3,), or None; far : bool, too far to be in the picture
    frame : ndarray of int, shape (c, 3), corners of all that the picture must show
    """

    floor: IntArray
    step: int
    foot: IntArray
    obstacles: tuple[SceneObject, ...]
    instrument: IntArray | None
    far: bool
    frame: IntArray


def surroundings(cell: Cell, arms: IntArray, length: float) -> ArmSurroundings:
    """What stands around an arm of some length [mm] that reaches the points (k, 3)."""
    step = floor_step(length)
    low, high = arms.min(axis=0), arms.max(axis=0)
    floor = floor_lines(low, high, step)
    frame = np.concatenate([arms, floor.reshape(-1, 3)])
    middle = (frame.min(axis=0) + frame.max(axis=0)) / 2.0
    patch = (low + high) / 2.0, max(1, round(length / 2.0 / step)) * step
    outlines = [_outline(obstacle, *patch, step) for obstacle in obstacles_of(cell)]
    instrument = None if cell.instrument is None else whole_mm(cell.instrument)

    def near(points: IntArray) -> bool:
        return bool((np.linalg.norm(points - middle, axis=-1) <= _NEAR * length).all())

    solids = tuple(o for o in outlines if o is not None)
    shown = [points for o in solids if near(points := whole_mm(np.concatenate(o.lines)))]
    if instrument is not None and near(instrument):
        shown.append(np.stack([instrument, instrument * [1, 1, 0]]))
    return ArmSurroundings(
        floor=floor,
        step=step,
        foot=whole_mm(ring(np.zeros(3), _FOOT * length / 1e3)),
        obstacles=solids,
        instrument=instrument,
        far=instrument is not None and not near(instrument),
        frame=hull(np.concatenate([frame, *shown])),
    )


def whole_mm(metres: Array) -> IntArray:
    """Metres to whole millimetres."""
    return np.asarray(np.rint(np.asarray(metres) * 1e3), dtype=int)


def floor_step(length: float) -> int:
    """Side of a floor cell [mm]: 1, 2 or 5 times a power of ten, for an arm of this length [mm].

    >>> [floor_step(length) for length in (900.0, 1300.0, 3000.0)]
    [100, 200, 500]
    """
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


def _outline(obstacle: Obstacle, middle: Array, half: float, step: int) -> SceneObject | None:
    """The body of an obstacle; a ball's outline is a circle from everywhere."""
    body, name = obstacle.body, obstacle.name
    if isinstance(body, Box):
        R, centre = body.T_base_box[:3, :3], body.T_base_box[:3, 3]
        low, high = (np.column_stack([_FACE, np.full(5, z)]) for z in (-1.0, 1.0))
        edges = (low, high, *np.stack([low, high], axis=1)[:4])
        lines = [centre + (line * body.half) @ R.T for line in edges]
        return SceneObject("solid", name, lines, NO_POINTS, centre[None], name)
    if isinstance(body, Ball):
        lines, at = [ring(body.centre, body.radius)], body.centre[None]
        return SceneObject("solid", name, lines, at, at, name, body.radius)
    return _patch(name, body, middle, half, step)


def _patch(
    name: str, space: HalfSpace, middle: Array, half: float, step: int
) -> SceneObject | None:
    """A grid in the plane where it is nearest to the arm; None where it is the floor itself."""
    normal = space.normal / np.linalg.norm(space.normal)
    centre = middle + normal * (normal @ (space.point * 1e3 - middle))
    if abs(normal[2]) > 1.0 - 1e-9 and abs(centre[2]) < _LEVEL:
        return None
    u, v = across(normal)
    grid = [line / 1e3 for line in grid_lines(centre, u, v, half, step)]
    return SceneObject("plane", name, grid, NO_POINTS, centre[None] / 1e3, name)


def hull(points: IntArray) -> IntArray:
    """Points whose hull holds all of them, shape (c, 3)."""
    from scipy.spatial import ConvexHull, QhullError

    points = np.unique(points, axis=0)
    try:
        return np.asarray(points[ConvexHull(points).vertices])
    except QhullError:  # all in one plane
        return points
