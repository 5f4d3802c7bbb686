"""Distances between points of different poses: a check that is free of frames.

How far two measured points are from each other depends neither on where the instrument stands nor on
how it is turned; errors of these distances are the arm's and the marker's own.
"""

from __future__ import annotations

import numpy as np

from calib.arrays import Array, IntArray
from calib.poses import Measurements

_NEAR_M = 0.05  # pairs closer than this say little of the arm
_MOST = 400_000


def pair_errors(data: Measurements, predicted: Array) -> Array:
    """Measured minus predicted distances of the pairs of poses, marker by marker, shape (n,), m.

    predicted : ndarray, shape (m, M, 3), m
    Pairs within one station, 50 mm apart and more; of very many an even part.
    """
    first, second = _pairs(data.poses.station, _MOST // data.seen.shape[1])
    found = []
    for j in range(data.seen.shape[1]):
        both = data.seen[first, j] & data.seen[second, j]
        a, b = first[both], second[both]
        measured = np.linalg.norm(data.points[a, j] - data.points[b, j], axis=-1)
        expected = np.linalg.norm(predicted[a, j] - predicted[b, j], axis=-1)
        found.append((measured - expected)[measured >= _NEAR_M])
    return np.concatenate(found)


def _pairs(station: IntArray, most: int) -> tuple[IntArray, IntArray]:
    """Pairs (i, j), i < j, of poses of one station, each once: all, or an even choice of very many.

    station : ndarray of int, shape (m,)
    Pair k of n poses numbered as (0,1), (0,2), (1,2), (0,3), .. is ``j = (1 + sqrt(1 + 8 k)) / 2``
    rounded down and ``i = k - j (j - 1) / 2``: no more of them are made than are taken.
    """
    members = [np.flatnonzero(station == s) for s in np.unique(station)]
    counts = [len(own) * (len(own) - 1) // 2 for own in members]
    step = max(1, -(-sum(counts) // most))
    first, second, before = [], [], 0
    for own, count in zip(members, counts, strict=True):
        k = np.arange(-before % step, count, step)
        j = ((1.0 + np.sqrt(1.0 + 8.0 * k)) / 2.0).astype(int)
        first.append(own[k - j * (j - 1) // 2])
        second.append(own[j])
        before += count
    return np.concatenate(first), np.concatenate(second)
