"""Days on which an arm scatters, by dense algebra that shares nothing with ``calib.scatter``."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arrays import Array
from calib.poses import Poses, poses_at


@dataclass(frozen=True)
class Day:
    """Rows of a linear model with their covariance, parts by level.

    H : ndarray, shape (N, n + 6), levers; visit, place : ndarray of int, shape (N,), of each row
    """

    poses: Poses
    H: Array
    visit: Array
    place: Array

    def covariance(self, scale: float, approach: Array, configuration: Array) -> Array:
        """Of all rows, (N, N), entry by entry; variances of the levers, (n + 6,)."""
        of_visit = (self.H * approach) @ self.H.T * (self.visit[:, None] == self.visit)
        of_place = (self.H * configuration) @ self.H.T * (self.place[:, None] == self.place)
        return np.asarray(scale**2 * np.eye(len(self.H)) + of_visit + of_place)


def visits_of(places: int, approaches: int, readings: int) -> Poses:
    """Places that are all visited, then all visited again, each time read so often without a move."""
    q = np.random.default_rng(5).uniform(-1.5, 1.5, (places, 3))
    return poses_at(np.repeat(np.tile(q, (approaches, 1)), readings, axis=0))
