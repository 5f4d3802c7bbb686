"""A day of measurement: the poses of a plan in their order, the ways between them, and the time."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib.arrays import Array, IntArray
from calib.cell import Cell
from calib.poses import Poses
from doe.day.approach import last_move
from doe.day.duration import durations, paced
from doe.day.order import bound_of, shortest_order
from doe.day.ways import JointPath, checked_in, times_between, ways_along

_AVOIDED = 10.0  # times the longest way: a way that nobody knows


@dataclass(frozen=True, eq=False)
class DrivenPoint:
    """A point that the arm drives to, all joints moving straight.

    q : ndarray, shape (dof,), rad or m; pose : str, the pose that it leads to, or is
    kind : str, "pose", "approach" where the prescribed last move begins, or "way"
    """

    q: Array
    pose: str
    kind: str


@dataclass(frozen=True, eq=False)
class PlannedDay:
    """What a plan takes.

    cell : Cell; poses : Poses, those of the plan in their order
    ways : tuple of JointPath, m - 1, each with the last move that the plan prescribes
    checked : tuple of str, what the ways are checked for
    first : JointPath, the last move to the first pose, where one is prescribed
    """

    cell: Cell
    poses: Poses
    ways: tuple[JointPath, ...]
    checked: tuple[str, ...]
    first: JointPath | None = None

    @property
    def direct(self) -> int:
        """Ways that are straight and free."""
        return sum(not way.meets for way in self.ways)

    @property
    def blocked(self) -> tuple[int, ...]:
        """Numbers of the ways on which something is met, as no way round was found."""
        return tuple(i for i, way in enumerate(self.ways) if not way.free)

    @property
    def speedless(self) -> tuple[str, ...]:
        """Joints of which no speed is known."""
        robot = self.cell.robot
        given = np.full(robot.dof, np.nan) if robot.speeds is None else robot.speeds
        return tuple(j for j, v in zip(robot.joints, given, strict=True) if np.isnan(v))

    @property
    def moving(self) -> float:
        """Seconds on the way, NaN where not all speeds are known."""
        return sum(way.seconds for way in self.ways) if paced(self.cell) else float("nan")

    @property
    def standing(self) -> float:
        """Seconds at the poses: settling, reading, and hanging the load and taking it off."""
        return len(self.poses) * self.cell.pace.standing(self.cell.load is not None)

    @property
    def seconds(self) -> float:
        """The whole day, from the first pose on; NaN where not all speeds are known."""
        return self.moving + self.standing

    @property
    def times(self) -> Array:
        """When the reading at each pose begins, s after the first, shape (m,); NaN as above."""
        ways = np.array([way.seconds if paced(self.cell) else np.nan for way in self.ways])
        return np.append(0.0, np.cumsum(ways + self.cell.pace.standing(self.cell.load is not None)))

    @property
    def timed(self) -> Poses:
        """The poses with their places in the order and, where all speeds are known, their times."""
        time = self.times if paced(self.cell) else None
        return replace(self.poses, time=time, start=0.0, order=np.arange(float(len(self.poses))))

    @property
    def before(self) -> tuple[Array, ...]:
        """Points that the arm drives to on the way to each pose, m arrays of shape (k, dof)."""
        none = np.zeros((0, self.cell.robot.dof))
        first = none if self.first is None else self.first.points[:-1]
        return (first, *(way.between for way in self.ways)) if len(self.poses) else ()

    @property
    def driven(self) -> tuple[DrivenPoint, ...]:
        """All points that the arm drives to, in turn."""
        found, prescribed = [], self.first is not None
        for name, q, before in zip(self.poses.names, self.poses.q, self.before, strict=True):
            kinds = ["way"] * len(before)
            kinds[-1:] = ["approach"] if prescribed and kinds else kinds[-1:]
            found += [
                DrivenPoint(point, name, kind) for point, kind in zip(before, kinds, strict=True)
            ]
            found.append(DrivenPoint(q, name, "pose"))
        return tuple(found)

    @cached_property
    def least_moving(self) -> float:
        """No order of these poses, by whatever ways, takes less on the way; NaN as above."""
        seconds = _straight_times(self.cell, self.poses.q, last_move(self.cell, self.poses))
        reached = float(np.diagonal(seconds, 1).sum())
        return min(bound_of(np.minimum(seconds, seconds.T), reached), self.moving)


def day_of(cell: Cell, poses: Poses, around: bool = True) -> PlannedDay:
    """The day of poses in their order.

    around : whether a way round is looked for where the straight one meets something
    """
    checked, move = checked_in(cell).names, last_move(cell, poses)
    if move is None or not move.any() or not len(poses):
        return PlannedDay(cell, poses, ways_along(cell, poses.q, around), checked)
    points = np.stack([poses.q - move, poses.q], axis=1).reshape(-1, poses.q.shape[1])
    first, *others = ways_along(cell, points, around)
    ways = (before.then(last) for before, last in zip(others[::2], others[1::2], strict=True))
    return PlannedDay(cell, poses, tuple(ways), checked, first)


def quickest_order(cell: Cell, q: Array, move: Array | None = None) -> IntArray:
    """The order of poses (m, dof) in which little time is spent between them; it ends anywhere.

    move : ndarray, shape (m, dof), the last move to each, where one is prescribed
    """
    return shortest_order(travel_times(cell, q, move))


def travel_times(cell: Cell, q: Array, move: Array | None = None) -> Array:
    """Seconds between poses as :func:`quickest_order` has them, either way, shape (m, m).

    Much where no way is known, so that none is taken.
    """
    seconds = times_between(cell, q)
    known = seconds[np.isfinite(seconds)].max(initial=1.0)
    seconds = np.where(np.isfinite(seconds), seconds, _AVOIDED * known)
    if move is not None:
        more = _straight_times(cell, q, move) - _straight_times(cell, q, None)
        seconds = seconds + 0.5 * (more + more.T)
    return seconds


def _straight_times(cell: Cell, q: Array, move: Array | None) -> Array:
    """Seconds from each pose (m, dof) to each other, straight but for its last move, shape (m, m)."""
    last = np.zeros_like(q) if move is None else move
    return durations(cell, q - last - q[:, None]) + durations(cell, last)
