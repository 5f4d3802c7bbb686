"""Fewer readings of a long table: evenly from each stay of the arm, then stay after stay."""

from __future__ import annotations

import numpy as np

from calib.arrays import IntArray, Mask
from calib.poses import Measurements
from calib.poses.visits import visits


def thinned(data: Measurements, most: int) -> tuple[Measurements, tuple[str, ...]]:
    """At most so many readings of a table, and a sentence that says so; all, and none, if they are few.

    Readings of one stay repeat each other but for the instrument's noise: every stay keeps as many as
    all others, evenly over its time, or all that it has. Where there are more stays than that, an even
    choice of them keeps one reading each.
    """
    if len(data) <= most:
        return data, ()
    stay = visits(data.poses) - 1
    counts = np.bincount(stay)
    each = _each(counts, most)
    order = np.argsort(stay, kind="stable")
    place = np.empty(len(data), dtype=int)  # of each reading in its stay
    place[order] = np.arange(len(data)) - np.repeat(np.cumsum(counts) - counts, counts)
    kept = _even(place, counts[stay], each)
    if len(counts) > most:
        kept &= _even(stay, np.array(len(counts)), most)
    own = data.take(kept)
    among = "spread evenly over all" if each == 1 else "the same number at each stop of the arm"
    return own, (f"{len(own)} of {len(data)} readings were used, {among}",)


def _each(counts: IntArray, most: int) -> int:
    """The largest number of readings of a stay, one at least, of which all have at most so many."""
    low, high = 1, max(int(counts.max()), 1)
    while low < high:
        middle = (low + high + 1) // 2
        fits = int(np.minimum(counts, middle).sum()) <= most
        low, high = (middle, high) if fits else (low, middle - 1)
    return low


def _even(place: IntArray, count: IntArray, most: int) -> Mask:
    """Whether each place among ``count`` is one of at most so many that lie evenly."""
    part = place * np.minimum(count, most) // count
    before = (place - 1) * np.minimum(count, most) // count
    return np.asarray(part != before)
