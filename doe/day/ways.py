"""The ways of a day: from each pose to the next one, straight where nothing is met, else round it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, IntArray, TextArray
from calib.cell import Cell
from doe.constraints import constraints_of, scene_of
from doe.constraints.clearance import Clearance, Lasting
from doe.constraints.kept_sight import kept_sights
from doe.day.duration import durations
from doe.day.roadmap import ways_round
from doe.day.straight import straight

_NEAR = 40  # poses of each to which the straight way is tried


@dataclass(frozen=True, eq=False)
class JointPath:
    """The way from one pose to another.

    points : ndarray, shape (k, dof), rad or m, between which the joints move straight, both poses among
        them; only these where no way was found
    meets : str, what the straight motion meets, "" where nothing
    free : bool, whether it is proved that nothing is met on the way
    follows : str, the marker that stays in sight, "" where none is asked for
    seconds : float, from rest to rest; it stops at every point
    """

    points: Array
    meets: str
    free: bool
    follows: str
    seconds: float

    @property
    def between(self) -> Array:
        """Points on the way that are no poses, shape (k - 2, dof)."""
        return self.points[1:-1]

    def then(self, other: JointPath) -> JointPath:
        """The way and, from its end, another."""
        follows = self.follows if self.follows == other.follows else ""
        return JointPath(
            np.concatenate([self.points, other.points[1:]]),
            self.meets or other.meets,
            self.free and other.free,
            follows,
            self.seconds + other.seconds,
        )


@dataclass(frozen=True)
class Checked:
    """What ways are checked for in a cell.

    shapes : tuple of Lasting, that hold all along; sights : of which one does, if there is any
    """

    shapes: tuple[Lasting, ...]
    sights: tuple[Lasting, ...]

    @property
    def choices(self) -> tuple[tuple[Lasting, ...], ...]:
        """Constraints that must hold all along a way, one set of several."""
        return tuple((*self.shapes, sight) for sight in self.sights) or (self.shapes,)

    @property
    def names(self) -> tuple[str, ...]:
        """What they are."""
        return (*(own.name for own in self.shapes), *(["line of sight"] if self.sights else []))


def checked_in(cell: Cell) -> Checked:
    """What the ways in a cell can be checked for."""
    shapes = tuple(own for own in constraints_of(cell) if isinstance(own, Clearance))
    return Checked(shapes, kept_sights(cell))


def broken_at(cell: Cell, q: Array) -> TextArray:
    """What each pose (n, dof) itself breaks, "" where nothing, shape (n,)."""
    scene, checked = scene_of(cell, q), checked_in(cell)
    found = np.full(len(q), "", dtype=object)
    for own in reversed(checked.shapes):
        found[~own.allows(scene)] = own.name
    return found


def times_between(cell: Cell, q: Array) -> Array:
    """Seconds of the quickest way that is known between poses (n, dof), shape (n, n).

    It is straight, or leads over others of the poses; infinite where none is known.
    """
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import dijkstra

    a, b = _near(cell, q)
    free = np.any(
        [straight(cell, own, q[a], q[b]).free for own in checked_in(cell).choices], axis=0
    )
    # To the graph, an edge of no time is none.
    seconds = np.maximum(durations(cell, q[b] - q[a])[free], 1e-9)
    graph = csr_array((seconds, (a[free], b[free])), shape=(len(q),) * 2)
    return np.asarray(dijkstra(graph, directed=False))


def ways_along(cell: Cell, q: Array, around: bool = True) -> tuple[JointPath, ...]:
    """The n - 1 ways from each of n poses (n, dof) to the next.

    around : whether a way round is looked for where the straight one meets something
    """
    checked = checked_in(cell)
    tried = [straight(cell, kept, q[:-1], q[1:]) for kept in checked.choices]
    free = np.array([own.free for own in tried])
    chosen, points = free.argmax(axis=0), [q[i : i + 2] for i in range(len(q) - 1)]
    sure = np.array(free.any(axis=0))
    blocked = np.flatnonzero(~sure)
    meets = np.full(len(q) - 1, "", dtype=object)
    meets[blocked] = [checked.choices[0][tried[0].met[i]].name for i in blocked]
    for number, kept in enumerate(checked.choices if around else ()):
        left = blocked[~sure[blocked]]
        found = ways_round(cell, kept, q[left], q[left + 1], q)
        for i, way in zip(left, found, strict=True):
            if way is not None:
                points[i], chosen[i], sure[i] = way, number, True
    follows = [own.name.removeprefix("sight of ") for own in checked.sights]
    followed = [
        follows[k] if follows and known else "" for k, known in zip(chosen, sure, strict=True)
    ]
    return tuple(
        JointPath(own, meets[i], bool(sure[i]), followed[i], _seconds(cell, own))
        for i, own in enumerate(points)
    )


def _seconds(cell: Cell, points: Array) -> float:
    return float(durations(cell, np.diff(points, axis=0)).sum())


def _near(cell: Cell, q: Array) -> tuple[IntArray, IntArray]:
    """Pairs of poses between which the straight way is tried: all of few, of many the nearest."""
    apart = durations(cell, q[:, None] - q)
    near = np.argsort(apart, axis=1, kind="stable")[:, 1 : _NEAR + 1]
    pairs = np.stack([np.repeat(np.arange(len(q)), near.shape[1]), near.ravel()])
    a, b = np.unique(np.sort(pairs, axis=0), axis=1)
    return a[a < b], b[a < b]
