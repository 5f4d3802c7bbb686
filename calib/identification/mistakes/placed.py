"""The nominal arm laid over some readings, and how far it misses each of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, IntArray, Mask
from calib.identification.initial import initial_values
from calib.model import Model
from calib.poses import Measurements

_GROSS = 10.0  # times the median miss: a pose beyond it has an error of its own
_ROUNDS = 4
_RIGID = np.array([0, 3, 5, 6])  # coordinates of a body that 0, 1, 2 or more markers fix
_PLACED = 12  # coordinates that base and tool take at most
_SPARE = 12  # more than these must fit as well: a wrong reading does so by chance never


@dataclass(frozen=True, eq=False)
class Placed:
    """Base and markers under the nominal arm.

    values : ndarray, shape (p,), SI; missed : ndarray, shape (m,), m, root mean square of each pose's
        markers; kept : ndarray of bool, shape (m,), all but gross errors
    spread : float, m, of the points of the poses kept about their middle, RMS
    """

    values: Array
    missed: Array
    kept: Mask
    spread: float

    @property
    def share(self) -> float:
        """What is missed of the spread of the points."""
        return self.rms / self.spread if self.spread > 0.0 else np.inf

    @property
    def rms(self) -> float:
        """Root mean square of the poses kept, m."""
        return float(np.sqrt(np.mean(self.missed[self.kept] ** 2)))


def placed(model: Model, data: Measurements, rounds: int = _ROUNDS) -> Placed:
    """Fit base and markers, again without the poses that stand far out as long as those change."""
    seen = np.asarray(data.seen.any(axis=1))
    kept = seen
    for _ in range(rounds):
        values = initial_values(model, data.take(kept))
        missed = missed_by(model, data, values)
        near = seen & (missed <= _GROSS * np.median(missed[kept]))
        if np.array_equal(near, kept):
            break
        kept = near
    points = data.points[kept][data.seen[kept]]
    return Placed(values, missed, kept, float(np.sqrt(points.var(axis=0).sum())))


def missed_by(model: Model, data: Measurements, values: Array) -> Array:
    """How far the readings of each pose lie from where they are predicted, RMS, shape (m,), m."""
    off = model.off(values, data)
    return np.asarray(np.sqrt((off**2).sum(axis=(1, 2)) / np.maximum(data.seen.sum(axis=1), 1)))


def some(data: Measurements, count: int) -> Measurements:
    """At most so many of the readings, one of each configuration."""
    _, first = np.unique(data.poses.configuration, return_index=True)
    chosen: IntArray = np.random.default_rng(0).permutation(first)[:count]
    return data.take(np.sort(chosen))


def telling(data: Measurements) -> bool:
    """Whether readings are so many that they do not fit a wrong idea by chance."""
    markers = np.minimum(data.seen.sum(axis=1), 3)
    return bool(_RIGID[markers].sum() >= _PLACED + _SPARE)
