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
class PlannedDay:
    """What a plan takes.

    cell : Cell; poses : Poses, m of them in their order
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
        """When the reading of each pose begins, s after that of the first, shape (m,); NaN as above."""
        each = self.cell.pace.standing(self.cell.load is not None)
        between = [way.seconds + each for way in self.ways] if paced(self.cell) else np.full(
            len(self.ways), np.nan
        )  # fmt: skip
        return np.append(0.0, np.cumsum(between))

    @property
    def timed(self) -> Poses:
        """The poses with their places in the order and, where all speeds are known, their times."""
        time = self.times if paced(self.cell) else None
        return replace(self.poses, time=time, start=0.0, order=np.arange(float(len(self.poses))))

    @cached_property
    def least_moving(self) -> float:
        """No order of these poses, by whatever ways, takes less on the way; NaN as above."""
        q = self.poses.q
        seconds = durations(self.cell, q[:, None] - q)
        return min(bound_of(seconds, float(np.diagonal(seconds, 1).sum())), self.moving)


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


def quickest_order(cell: Cell, q: Array) -> IntArray:
    """The order of poses (m, dof) in which little time is spent between them; it ends anywhere."""
    return shortest_order(travel_times(cell, q))


def travel_times(cell: Cell, q: Array) -> Array:
    """Seconds between poses (m, dof), shape (m, m): much where no way is known."""
    seconds = times_between(cell, q)
    known = seconds[np.isfinite(seconds)].max(initial=1.0)
    return np.where(np.isfinite(seconds), seconds, _AVOIDED * known)
