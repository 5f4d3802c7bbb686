"""Blocks of poses that are read under one load and, on the way back, under the other.

A load that takes minutes to change is a factor that is hard to change: it is changed where a block
turns round, and the next block begins as the last one ended (a split plot; Jones, Nachtsheim, Journal
of Quality Technology 41(4), 2009).
"""

from __future__ import annotations

import numpy as np

from calib.arrays import Array, IntArray


def even_blocks(count: int, poses: int) -> IntArray:
    """Block of each of m poses in their order, shape (m,), from 1; as even as can be."""
    return 1 + np.arange(poses) * count // poses


def turns(block: IntArray) -> IntArray:
    """Readings of m poses in the order of measuring, shape (2 m,).

    The free ones are 0 .. m - 1, the loaded ones m .. 2 m - 1.
    block : ndarray of int, shape (m,), of poses in their order; the first one begins free
    """
    both, found = np.arange(2 * len(block)).reshape(2, -1), []
    for number, own in enumerate(np.unique(block)):
        there, back = np.roll(both[:, block == own], number, axis=0)
        found += [there, back[::-1]]
    return np.concatenate(found)


def second_times(block: IntArray, time: Array, change: float) -> Array:
    """When poses are read on the way back, shape (m,), s: as long after the turn as before it.

    time : ndarray, shape (m,), s, on the way there; change : s, from the last reading to the next, in
        which the load is changed
    """
    turned = np.array([time[block == own].max() for own in block])
    return np.asarray(2.0 * turned - time + change)
