"""A day of measurement: the poses of a plan in their order, and the time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, IntArray
from calib.cell import Cell
from calib.poses import Poses
from doe.day.duration import durations, paced
from doe.day.order import shortest_order


@dataclass(frozen=True, eq=False)
class PlannedDay:
    """What a plan takes.

    cell : Cell; poses : Poses, those of the plan in their order
    ways : ndarray, shape (m - 1,), s from each to the next, the joints moving straight
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


def day_of(cell: Cell, poses: Poses) -> PlannedDay:
    """The day of poses in their order."""
    return PlannedDay(cell, poses, durations(cell, np.diff(poses.q, axis=0)))


def quickest_order(cell: Cell, q: Array) -> IntArray:
    """The order of poses (m, dof) in which little time is spent between them; it ends anywhere."""
    return shortest_order(durations(cell, q - q[:, None]))
