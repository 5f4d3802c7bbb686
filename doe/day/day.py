"""A day of measurement: the poses of a plan in their order, the ways between them, and the time.

The load is a factor that is hard to change. Every pose is read free and loaded, and the load is changed
at each pose, or once for a block of poses (:mod:`calib.poses.load_blocks`). Readings of one visit share
what its approach was off by, those of two do not.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from calib.api import in_turn, turn_of
from calib.arrays import Array, IntArray, Mask
from calib.cell import Cell
from calib.poses import Poses
from calib.poses.load_blocks import even_blocks
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
    stops : Poses, m visits in turn: the poses, or in blocks of load their readings, free and loaded
    ways : tuple of JointPath, m - 1, each with the last move that the plan prescribes
    checked : tuple of str, what the ways are checked for
    first : JointPath, the last move to the first pose, where one is prescribed
    """

    cell: Cell
    poses: Poses
    stops: Poses
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
    def changes(self) -> Mask:
        """Stops that begin with a change of the load, shape (m,), where there are blocks."""
        mass = self.stops.load_mass
        return np.asarray(np.diff(mass, prepend=mass[:1]) != 0.0)

    @property
    def standing(self) -> float:
        """Seconds at the poses: settling, reading, and hanging the load and taking it off."""
        return float(sum(own.sum() for own in self._at_stops))

    @property
    def _at_stops(self) -> tuple[Array, Array]:
        """Seconds at each stop before a reading begins, and from then on, shape (m,) each."""
        pace, count = self.cell.pace, len(self.stops)
        before = np.full(count, pace.settle)
        if self.poses.load_block is not None:
            return before + pace.load * self.changes, np.full(count, pace.reading)
        return before, np.full(count, pace.standing(self.cell.load is not None) - pace.settle)

    @property
    def seconds(self) -> float:
        """The whole day, from the first pose on; NaN where not all speeds are known."""
        return self.moving + self.standing

    @property
    def times(self) -> Array:
        """When the reading at each stop begins, s after the first, shape (m,); NaN as above."""
        ways = np.array([way.seconds if paced(self.cell) else np.nan for way in self.ways])
        before, after = self._at_stops
        return np.append(0.0, np.cumsum(after[:-1] + ways + before[1:]))

    @property
    def timed(self) -> Poses:
        """The poses with their places in the order and, where all speeds are known, their times.

        In blocks of load, those of the way there.
        """
        time = self.times if paced(self.cell) else None
        if time is not None and self.poses.load_block is not None:
            pose = turn_of(self.cell, self.poses) % len(self.poses)
            time = time[np.unique(pose, return_index=True)[1]]
        return replace(self.poses, time=time, start=0.0, order=np.arange(float(len(self.poses))))

    @property
    def before(self) -> tuple[Array, ...]:
        """Points that the arm drives to on the way to each stop, m arrays of shape (k, dof)."""
        none = np.zeros((0, self.cell.robot.dof))
        first = none if self.first is None else self.first.points[:-1]
        return (first, *(way.between for way in self.ways)) if len(self.stops) else ()

    @property
    def driven(self) -> tuple[DrivenPoint, ...]:
        """All points that the arm drives to, in turn."""
        found, prescribed = [], self.first is not None
        for name, q, before in zip(self.stops.names, self.stops.q, self.before, strict=True):
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
    blocks = poses.load_block is not None
    stops = in_turn(cell, poses) if blocks else poses
    checked, move = checked_in(cell).names, last_move(cell, stops)
    if move is None or not move.any() or not len(stops):
        return PlannedDay(cell, poses, stops, ways_along(cell, stops.q, around), checked)
    points = np.stack([stops.q - move, stops.q], axis=1).reshape(-1, stops.q.shape[1])
    first, *others = ways_along(cell, points, around)
    ways = (before.then(last) for before, last in zip(others[::2], others[1::2], strict=True))
    return PlannedDay(cell, poses, stops, tuple(ways), checked, first)


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


BLOCKS = (1, 2, 4)
"""Into how many blocks the poses are divided."""


@dataclass(frozen=True)
class LoadSchedule:
    """One way to change the load.

    changes : int, that it is hung or taken off; after : tuple of str, poses after which, empty where it
        is at each
    changing, seconds : float, that the changes and the day take; the day NaN where not all joint speeds
        are known
    task_rms : float, m, expected at the targets
    planned : whether the plan has it
    """

    changes: int
    after: tuple[str, ...]
    changing: float
    seconds: float
    task_rms: float
    planned: bool


def in_blocks(poses: Poses, count: int) -> Poses:
    """The poses of a plan in so many blocks of load."""
    return replace(poses, load_block=even_blocks(count, len(poses)))


def schedules_of(
    day: PlannedDay, planned: PlannedDay, at_each: float, apart: float
) -> tuple[LoadSchedule, ...]:
    """The load changed at each pose, and once for each of some blocks of poses.

    day : with a change at each pose; planned : as the plan has it, the same or in blocks
    at_each, apart : m, expected error with both readings of a pose in one visit, and in two
    """
    names, count, each = day.poses.names, len(day.poses), day.cell.pace.load
    own = planned.poses.load_block
    chosen = 0 if own is None else int(own[-1])
    found = [LoadSchedule(2 * count, (), 2 * count * each, day.seconds, at_each, not chosen)]
    for blocks in sorted({*BLOCKS, chosen} - {0}):
        if blocks > count // 2:
            break
        ends = np.flatnonzero(np.diff(even_blocks(blocks, count), append=blocks + 1))
        # Blocks begin and end loaded in turn: each change is where a block turns round, at its end.
        after = tuple(names[end] for end in ends)
        seconds = planned.seconds if blocks == chosen else _seconds(day, ends)
        found.append(LoadSchedule(blocks, after, blocks * each, seconds, apart, blocks == chosen))
    return tuple(found)


def _seconds(day: PlannedDay, ends: IntArray) -> float:
    """A day of blocks, each there and back, and over it once more to the next: at most so long."""
    pace, starts = day.cell.pace, np.append(0, ends[:-1] + 1)
    ways: Array = np.array([way.seconds for way in day.ways])
    there = sum(float(ways[a:b].sum()) for a, b in zip(starts, ends, strict=True))
    over = sum(float(ways[a:b].sum()) for a, b in pairwise(starts))
    moving = 2.0 * there + over if np.isfinite(day.moving) else np.nan
    readings = 2 * len(day.poses) * (pace.settle + pace.reading)
    return moving + readings + len(ends) * pace.load
