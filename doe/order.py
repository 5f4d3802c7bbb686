"""A day of measurement: the poses of a plan in a short order, and the time that they take."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, IntArray
from calib.cell import Cell
from calib.poses import Poses

_FULL_SPEED_IN = 0.5  # s, from rest, where no acceleration is given
_STARTS = 12  # places from which a way is begun
_LEAST = 1e-9  # of the mean cost: an improvement


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
        return float("nan") if self.speedless else sum(self.ways.tolist())

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


def durations(cell: Cell, steps: Array) -> Array:
    """Seconds that straight motions (.., dof), rad or m, take from rest to rest, shape (..).

    All joints begin and end together: the slowest one is accelerated, driven at its speed and braked.
    Where not all speeds are known the joints count as equally fast, one a second: it only compares.
    """
    robot, share = cell.robot, cell.pace.speed
    known = robot.speeds is not None and not np.isnan(robot.speeds).any()
    speeds = robot.speeds if robot.speeds is not None and known else np.ones(robot.dof)
    given = np.full(robot.dof, np.nan) if robot.accelerations is None else robot.accelerations
    v, a = share * speeds, share * np.where(np.isnan(given), speeds / _FULL_SPEED_IN, given)
    far = np.abs(steps)
    return np.asarray(
        np.where(far * a >= v**2, far / v + v / a, 2.0 * np.sqrt(far / a)).max(axis=-1)
    )


def travel(q: Array) -> float:
    """Joint travel of a sequence q, shape (m, n), of joints of one unit: of each move the farthest."""
    return float(np.abs(np.diff(q, axis=0)).max(axis=1, initial=0.0).sum())


def quickest_order(cell: Cell, q: Array) -> IntArray:
    """The order of poses (m, dof) in which little time is spent between them; it ends anywhere."""
    return shortest_order(durations(cell, q - q[:, None]))


def shortest_order(cost: Array) -> IntArray:
    """Order of n places with a small sum of costs (n, n) from each to the next; it ends anywhere.

    From some of the places to the nearest one that is left, and so on; then stretches are reversed
    while that helps (Croes, Operations Research 6(6), 1958). The shortest of these ways is taken.
    """
    n = len(cost)
    if n < 3:
        return np.arange(n)
    starts = np.unique(np.linspace(0, n - 1, _STARTS).astype(int))
    ways = [_improved(_nearest(int(start), cost), cost) for start in starts]
    way = min(ways, key=lambda way: float(cost[way[:-1], way[1:]].sum()))
    # Of a way and its reverse, which are equally long, the one that begins with the earlier place.
    return np.asarray(way if way[0] < way[-1] else way[::-1])


def _nearest(start: int, cost: Array) -> IntArray:
    way, left = [start], np.ones(len(cost), dtype=bool)
    left[start] = False
    while left.any():
        way.append(int(np.where(left, cost[way[-1]], np.inf).argmin()))
        left[way[-1]] = False
    return np.array(way)


def _improved(way: IntArray, cost: Array) -> IntArray:
    """The way after the best reversals, one after another, until none helps."""
    least = -_LEAST * float(cost.mean())
    while True:
        # Ends join nothing: a place of no cost stands before the first one and after the last.
        step = cost[way[:-1], way[1:]]
        before, after = np.append(0.0, step), np.append(step, 0.0)
        joined = np.zeros((len(way), len(way)))
        joined[1:] += cost[way[:-1, None], way]  # the one before i is followed by j
        joined[:, :-1] += cost[way[:, None], way[1:]]  # and i by the one after j
        gain = joined - before[:, None] - after
        gain[np.tril_indices(len(way))] = 0.0
        i, j = np.unravel_index(int(gain.argmin()), gain.shape)
        if gain[i, j] >= least:
            return way
        way = np.concatenate([way[:i], way[i : j + 1][::-1], way[j + 1 :]])
