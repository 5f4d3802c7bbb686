"""The criteria of ISO 9283:1998 as formulas, lengths in m and angles in rad; n cycles each.

With fewer cycles than the thirty of the standard the same figures are less sure, and their intervals
say by how much: of scatter by chi-square, of means by what covers them
(:mod:`calib.uncertainty.expanded`).
"""

from __future__ import annotations

import numpy as np

from calib.arrays import Array
from calib.uncertainty.expanded import LEVEL, Interval, coverage_factor, directions

_DIRECTIONS, _FREEDOM = (1.0, 2.0, 3.0), (0.90, 1.52, 2.04)


def position_accuracy(points: Array, commanded: Array) -> tuple[Interval, Array]:
    """AP (7.2.1) and its coordinates: mean attained point less the commanded one (3,).

    points : ndarray, shape (n, 3)
    """
    off, n = points.mean(axis=0) - commanded, len(points)
    value = float(np.linalg.norm(off))
    away = (points - points.mean(axis=0)) / np.sqrt(max(n - 1, 1) * n)
    spread = float(np.linalg.norm(away))
    sure = spread * float(coverage_factor(n - 1, directions(away.T))) if n > 1 else np.inf
    return Interval(value, max(0.0, value - sure), value + sure), off


def position_repeatability(points: Array) -> Interval:
    """RP (7.2.2) ``mean(l) + 3 S_l``, l the distances of points (n, 3) from their mean.

    Of points that scatter in d directions it is as sure as a standard deviation of 0.90, 1.52 and 2.04
    (n - 1) degrees of freedom for d of 1, 2 and 3 (moments of the chi distribution, delta method).
    """
    away = np.linalg.norm(points - points.mean(axis=0), axis=1)
    value = float(away.mean() + 3.0 * away.std(ddof=1))
    d = float(directions((points - points.mean(axis=0)).T))
    return of_scatter(value, float(np.interp(d, _DIRECTIONS, _FREEDOM)) * (len(points) - 1))


def angles(turns: Array) -> tuple[Array, Array]:
    """AP and RP of each angle, (3,): mean error, and ``3 S``; turns : ndarray, shape (n, 3)."""
    return turns.mean(axis=0), 3.0 * turns.std(axis=0, ddof=1)


def distances(first: Array, second: Array, commanded: float) -> tuple[Interval, Interval]:
    """AD and RD (7.3): mean distance less the commanded one, and ``3 S``.

    first, second : ndarray, shape (n, 3), points of two poses, cycle by cycle
    """
    apart = np.linalg.norm(first - second, axis=1)
    n, S = len(apart), float(apart.std(ddof=1))
    mean, sure = float(apart.mean()) - commanded, float(coverage_factor(n - 1)) * S / np.sqrt(n)
    return Interval(mean, mean - sure, mean + sure), of_scatter(3.0 * S, n - 1)


def largest_distance(means: Array) -> float:
    """vAP (7.2.3): the largest distance between mean points (k, 3), one of each way of coming."""
    return float(np.linalg.norm(means[:, None] - means[None], axis=-1).max())


def accuracy_drift(means: Array) -> float:
    """dAP (7.6): the largest distance of later mean points (k, 3) from the first."""
    return float(np.linalg.norm(means - means[0], axis=1).max())


def compliance(forces: Array, points: Array, sigma: float) -> Interval:
    """Static compliance (7.10), m/N: slope of displacements along a force over it, both (n,).

    sigma : m, of a displacement, which tells how sure it is where two readings cannot
    """
    x, y = forces - forces.mean(), points - points.mean()
    slope, n = float(x @ y / (x @ x)), len(x)
    left = float(np.sqrt(((y - slope * x) ** 2).sum() / (n - 2))) if n > 2 else sigma
    sure = float(coverage_factor(n - 2 if n > 2 else np.inf) * left / np.sqrt(x @ x))
    return Interval(slope, slope - sure, slope + sure)


def of_scatter(value: float, freedom: float) -> Interval:
    """A figure in proportion to a standard deviation of so many degrees of freedom."""
    from scipy.special import chdtri

    if not np.isfinite(freedom):
        return Interval(value, value, value)
    nu = max(freedom, 1.0)
    low, high = (float(np.sqrt(nu / chdtri(nu, p))) for p in ((1 - LEVEL) / 2, (1 + LEVEL) / 2))
    return Interval(value, value * low, value * high)


def repeatability_of(covariance: Array) -> float:
    """RP of endless cycles whose points are normal with a covariance (3, 3).

    The mean distance is ``E sqrt(x) = 1 / sqrt(pi) * integral over s of (1 - E exp(-x s^2)) / s^2``.
    """
    from scipy.integrate import quad

    total = float(np.trace(covariance))
    if total <= 0.0:
        return 0.0
    roots = np.linalg.eigvalsh(covariance) / total

    def part(s: float) -> float:
        """Its part at s and at 1 / s, so that s goes from zero to one."""
        near, far = (float(np.prod(1.0 + 2.0 * roots * x) ** -0.5) for x in (s**2, s**-2))
        return (1.0 - near) / s**2 + 1.0 - far

    mean = quad(part, 0.0, 1.0)[0] / np.sqrt(np.pi)
    return float(np.sqrt(total) * (mean + 3.0 * np.sqrt(1.0 - mean**2)))
