"""How often the load of a plan is hung and taken off: a factor that is hard to change.

Every pose is read free and loaded. The load is changed at each pose, or once for a block of poses,
which are visited free and, on the way back, loaded: a split plot (Jones, Nachtsheim, Journal of Quality
Technology 41(4), 2009). Readings of one visit share what its approach was off by, those of two do not.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from calib.arrays import Array, IntArray
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
    """

    changes: int
    after: tuple[str, ...]
    changing: float
    seconds: float
    task_rms: float


def schedules_of(day: PlannedDay, at_each: float, apart: float) -> tuple[LoadSchedule, ...]:
    """The load changed at each pose, and once for each of some blocks of poses.

    at_each, apart : m, expected error with both readings of a pose in one visit, and in two
    """
    names, count, each = day.poses.names, len(day.poses), day.cell.pace.load
    found = [LoadSchedule(2 * count, (), 2 * count * each, day.seconds, at_each)]
    for blocks in BLOCKS:
        if blocks > count // 2:
            break
        ends = np.arange(1, blocks + 1) * count // blocks - 1
        starts = np.append(0, ends[:-1] + 1)
        # Blocks begin and end loaded in turn: each change is where a block turns round, at its end.
        after = tuple(names[end] for end in ends)
        seconds = _seconds(day, starts, ends)
        found.append(LoadSchedule(blocks, after, blocks * each, seconds, apart))
    return tuple(found)


def _seconds(day: PlannedDay, starts: IntArray, ends: IntArray) -> float:
    """A day of blocks, each there and back; from its start to the next one's over the straight way."""
    pace = day.cell.pace
    ways: Array = np.array([way.seconds for way in day.ways])
    there = sum(float(ways[a:b].sum()) for a, b in zip(starts, ends, strict=True))
    # Back at the start of a block, the arm goes over it once more to the next.
    over = sum(float(ways[a:b].sum()) for a, b in pairwise(starts))
    moving = 2.0 * there + over if np.isfinite(day.moving) else np.nan
    readings = 2 * len(day.poses) * (pace.settle + pace.reading)
    return moving + readings + len(ends) * pace.load
