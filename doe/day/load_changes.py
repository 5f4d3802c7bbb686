"""How often the load of a plan is hung and taken off: a factor that is hard to change.

Every pose is read free and loaded. The load is changed at each pose, or once for a block of poses
(:mod:`calib.poses.load_blocks`). Readings of one visit share what its approach was off by, those of two
do not.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from calib.arrays import Array, IntArray
from calib.poses import Poses
from calib.poses.load_blocks import even_blocks
from doe.day.day import PlannedDay

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
