"""Noise that grows with the distance from the instrument, where the cell says that it does not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arrays import Array
from calib.poses import Measurements

_AGREES = 1e-3  # probability of as strong a trend by chance
_ROUNDS = 20
_FEWEST = 30


@dataclass(frozen=True, eq=False)
class Growth:
    """Standard deviation of each point over the mean one.

    relative : ndarray, shape (m, M); nearest, farthest : float, at the ends of the range
    """

    relative: Array
    nearest: float
    farthest: float


def growth(data: Measurements, r: Array) -> Growth | None:
    """How the residual grows with range, None where it does not.

    r : ndarray, shape (m, r C), whitened residuals, zero for what does not count
    Koenker's test (Journal of Econometrics 17(1), 1981) of the squared residuals against the range;
    then ``variance = a + b range^2`` by weighted least squares.
    """
    from scipy.special import chdtrc

    squares = (r.reshape(data.readings.shape) ** 2).mean(axis=-1)
    ranges = np.linalg.norm(np.where(data.seen[..., None], data.points, 0.0), axis=-1)
    used = data.seen & (squares > 0.0)
    x, y = ranges[used], squares[used]
    if len(x) < _FEWEST or np.ptp(x) <= 1e-6 * x.max():
        return None
    correlation = float(np.corrcoef(x, y)[0, 1])
    if correlation <= 0.0 or float(chdtrc(1, len(x) * correlation**2)) > _AGREES:
        return None
    basis = np.stack([np.ones_like(x), x**2], axis=-1)
    variance = np.full_like(y, y.mean())
    for _ in range(_ROUNDS):
        a, b = np.linalg.lstsq(basis / variance[:, None], y / variance, rcond=None)[0]
        variance = np.maximum(a + b * x**2, 0.05 * y.mean())
    mean = float(variance.mean())
    relative = np.sqrt(np.maximum(a + b * ranges**2, 0.05 * y.mean()) / mean)
    ends = np.sqrt(np.interp([x.min(), x.max()], np.sort(x), np.sort(variance)) / mean)
    return Growth(np.where(data.seen, relative, 1.0), float(ends[0]), float(ends[1]))
