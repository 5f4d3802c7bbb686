"""A day of measurement: the poses of a plan in their order, and the time."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.arrays import Array, IntArray
from calib.cell import Cell
from calib.poses import Poses
from doe.day.approach import last_move
from doe.day.duration import durations, paced
from doe.day.order import shortest_order


@dataclass(frozen=True, eq=False)
class PlannedDay:
    """What a plan takes.

    cell : Cell; poses : Poses, those of the plan in their order
    ways : ndarray, shape (m - 1,), s from each to the next, with the last move that the plan prescribes
    """

    cell: Cell
    poses: Poses
    ways: Array

    @property
    def speedless(self) -> tuple[str, ...]:
        """Joints of which no speed is known."""
        robot = self.cell.robot
        given = np.full(robot.dof, np.nan) if robot.speeds is None else robot.speeds
        return tuple(j for j, v in zip(robot.joints, given, strict=True) if np.isnan(v))

    @property
    def moving(self) -> float:
        """Seconds on the way, NaN where not all speeds are known."""
        return sum(self.ways.tolist()) if paced(self.cell) else float("nan")

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
        ways = self.ways if paced(self.cell) else np.full(len(self.ways), np.nan)
        return np.append(0.0, np.cumsum(ways + self.cell.pace.standing(self.cell.load is not None)))

    @property
    def timed(self) -> Poses:
        """The poses with their places in the order and, where all speeds are known, their times."""
        time = self.times if paced(self.cell) else None
        return replace(self.poses, time=time, start=0.0, order=np.arange(float(len(self.poses))))


def day_of(cell: Cell, poses: Poses) -> PlannedDay:
    """The day of poses in their order, the joints moving straight from each to the next."""
    move = last_move(cell, poses)
    begins = poses.q if move is None else poses.q - move
    ways = durations(cell, begins[1:] - poses.q[:-1]) + durations(cell, (poses.q - begins)[1:])
    return PlannedDay(cell, poses, ways)


def quickest_order(cell: Cell, q: Array, move: Array | None = None) -> IntArray:
    """The order of poses (m, dof) in which little time is spent between them; it ends anywhere.

    move : ndarray, shape (m, dof), the last move to each, where one is prescribed
    """
    return shortest_order(travel_times(cell, q, move))


def travel_times(cell: Cell, q: Array, move: Array | None = None) -> Array:
    """Seconds between poses as :func:`quickest_order` has them, either way, shape (m, m)."""
    seconds = _straight_times(cell, q, None)
    if move is not None:
        more = _straight_times(cell, q, move) - seconds
        seconds = seconds + 0.5 * (more + more.T)
    return seconds


def _straight_times(cell: Cell, q: Array, move: Array | None) -> Array:
    """Seconds from each pose (m, dof) to each other, straight but for its last move, shape (m, m)."""
    last = np.zeros_like(q) if move is None else move
    return durations(cell, q - last - q[:, None]) + durations(cell, last)
