"""Distances between points of different poses: a check that is free of frames.

How far two measured points are from each other depends neither on where the instrument stands nor on
how it is turned; errors of these distances are the arm's and the marker's own.
"""

from __future__ import annotations

import numpy as np

from calib.poses import Measurements
from calib.se3 import Array

_NEAR_M = 0.05  # pairs closer than this say little of the arm
_MOST = 400_000


def pair_errors(data: Measurements, predicted: Array) -> Array:
    """Measured minus predicted distances of the pairs of poses, marker by marker, shape (n,), m.

    predicted : ndarray, shape (m, M, 3), m
    Pairs within one station, 50 mm apart and more; of very many an even part.
    """
    found = []
    first, second = np.triu_indices(len(data), 1)
    same = data.poses.station[first] == data.poses.station[second]
    first, second = first[same], second[same]
    step = max(1, -(-len(first) * data.seen.shape[1] // _MOST))
    first, second = first[::step], second[::step]
    for j in range(data.seen.shape[1]):
        both = data.seen[first, j] & data.seen[second, j]
        a, b = first[both], second[both]
        measured = np.linalg.norm(data.points[a, j] - data.points[b, j], axis=-1)
        expected = np.linalg.norm(predicted[a, j] - predicted[b, j], axis=-1)
        found.append((measured - expected)[measured >= _NEAR_M])
    return np.concatenate(found)
