"""The criteria of ISO 9283:1998 as formulas, lengths in m and angles in rad; n cycles each.

With fewer cycles than the thirty of the standard the same figures are less sure, and their intervals
say by how much: of scatter by chi-square, of means by what covers them (:mod:`calib.expanded`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from calib.arrays import Array
from calib.expanded import LEVEL, coverage_factor, directions


class Figure(NamedTuple):
    """A value and its 95 % interval."""

    value: float
    low: float
    high: float


def position_accuracy(points: Array, commanded: Array) -> tuple[Figure, Array]:
    """AP (7.2.1) and its coordinates: mean attained point less the commanded one (3,).

    points : ndarray, shape (n, 3)
    """
    off, n = points.mean(axis=0) - commanded, len(points)
    value = float(np.linalg.norm(off))
    away = (points - points.mean(axis=0)) / np.sqrt(max(n - 1, 1) * n)
    spread = float(np.linalg.norm(away))
    sure = spread * float(coverage_factor(n - 1, directions(away.T))) if n > 1 else np.inf
    return Figure(value, max(0.0, value - sure), value + sure), off


def position_repeatability(points: Array) -> Figure:
    """RP (7.2.2) ``mean(l) + 3 S_l``, l the distances of points (n, 3) from their mean."""
    away = np.linalg.norm(points - points.mean(axis=0), axis=1)
    value = float(away.mean() + 3.0 * away.std(ddof=1))
    return of_scatter(
        value, float(directions((points - points.mean(axis=0)).T)) * (len(points) - 1)
    )


def angles(turns: Array) -> tuple[Array, Array]:
    """AP and RP of each angle, (3,): mean error, and ``3 S``; turns : ndarray, shape (n, 3)."""
    return turns.mean(axis=0), 3.0 * turns.std(axis=0, ddof=1)


def distances(first: Array, second: Array, commanded: float) -> tuple[Figure, Figure]:
    """AD and RD (7.3): mean distance less the commanded one, and ``3 S``.

    first, second : ndarray, shape (n, 3), points of two poses, cycle by cycle
    """
    apart = np.linalg.norm(first - second, axis=1)
    n, S = len(apart), float(apart.std(ddof=1))
    mean, sure = float(apart.mean()) - commanded, float(coverage_factor(n - 1)) * S / np.sqrt(n)
    return Figure(mean, mean - sure, mean + sure), of_scatter(3.0 * S, n - 1)


def largest_distance(means: Array) -> float:
    """vAP (7.2.3): the largest distance between mean points (k, 3), one of each way of coming."""
    return float(np.linalg.norm(means[:, None] - means[None], axis=-1).max())


def accuracy_drift(means: Array) -> float:
    """dAP (7.6): the largest distance of later mean points (k, 3) from the first."""
    return float(np.linalg.norm(means - means[0], axis=1).max())


def compliance(forces: Array, points: Array, sigma: float) -> Figure:
    """Static compliance (7.10), m/N: slope of displacements along a force over it, both (n,).

    sigma : m, of a displacement, which tells how sure it is where two readings cannot
    """
    x, y = forces - forces.mean(), points - points.mean()
    slope, n = float(x @ y / (x @ x)), len(x)
    left = float(np.sqrt(((y - slope * x) ** 2).sum() / (n - 2))) if n > 2 else sigma
    sure = float(coverage_factor(n - 2 if n > 2 else np.inf) * left / np.sqrt(x @ x))
    return Figure(slope, slope - sure, slope + sure)


def of_scatter(value: float, freedom: float) -> Figure:
    """A figure in proportion to a standard deviation of so many degrees of freedom."""
    from scipy.special import chdtri

    if not np.isfinite(freedom):
        return Figure(value, value, value)
    nu = max(freedom, 1.0)
    low, high = (float(np.sqrt(nu / chdtri(nu, p))) for p in ((1 - LEVEL) / 2, (1 + LEVEL) / 2))
    return Figure(value, value * low, value * high)


def repeatability_of(covariance: Array) -> float:
    """RP of points that scatter with a covariance (3, 3): mean and spread of their distance.

    Its square is taken for a gamma of the same mean and variance, which it is where the scatter is
    alike in the directions that it has.
    """
    from scipy.special import gammaln

    total = float(np.trace(covariance))
    if total <= 0.0:
        return 0.0
    k = total**2 / float((covariance**2).sum()) / 2.0
    mean = float(np.sqrt(total / k) * np.exp(gammaln(k + 0.5) - gammaln(k)))
    return mean + 3.0 * float(np.sqrt(max(total - mean**2, 0.0)))
