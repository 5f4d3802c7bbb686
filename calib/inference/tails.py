"""Tail probabilities of chi-square, F and weighted sums of chi-square variables."""

from __future__ import annotations

from math import copysign, log, sqrt

import numpy as np

from calib.arrays import Array

_ROUNDS, _PARTS = 12, 32
_AT_THE_MEAN = 1e-3  # standard deviations from the mean within which the formula loses its digits
_EQUAL = 1e-9  # relative difference of weights


def f_tail(value: float, numerator: float, denominator: float) -> float:
    """Probability that an F variable exceeds a value; of infinite ``denominator``, that
    ``chi-square / numerator`` does.
    """
    from scipy.special import chdtrc, fdtrc

    if not np.isfinite(denominator):
        return float(chdtrc(numerator, max(value, 0.0) * numerator))
    return float(fdtrc(numerator, denominator, max(value, 0.0)))


def weighted_tail(weights: Array, value: float, freedom: float = np.inf) -> float:
    """Probability that ``sum(w z^2)`` exceeds a value, z standard normal.

    weights : ndarray, shape (k,), not negative
    freedom : of the sum of squares, those of z included, by whose mean the sum is divided where the
        noise variance is estimated; ``k + freedom of the rest``

    Exact for equal weights; else by the saddlepoint formula of Lugannani and Rice for quadratic forms
    (Kuonen, Biometrika 86(4), 1999), whose relative error stays small far in the tail.
    """
    w = weights[weights > 0.0]
    if not len(w):
        return 1.0 if value <= 0.0 else 0.0
    k, infinite = len(w), not np.isfinite(freedom)
    share = 0.0 if infinite else value / freedom
    if share >= w.max():
        return 0.0
    if np.ptp(w) <= _EQUAL * w.max():
        rest, weight = freedom - k, float(w[0])
        if infinite:
            return f_tail(value / weight / k, k, rest)
        return f_tail(share / (weight - share) * rest / k, k, rest) if rest > 0.0 else 1.0
    if infinite:
        return _quadratic_tail(w, np.ones(k), value)
    counts = np.append(np.ones(k), max(freedom - k, 0.0))
    return _quadratic_tail(np.append(w - share, -share), counts, 0.0)


def _quadratic_tail(d: Array, counts: Array, value: float) -> float:
    """Probability that ``sum(d chi2_count)`` exceeds a value; d of any sign, not all zero."""
    from scipy.special import ndtr

    mean, deviation = float(counts @ d), sqrt(2.0 * float(counts @ d**2))
    if value <= 0.0 and d.min() >= 0.0:
        return 1.0
    aside = 2.0 * _AT_THE_MEAN * deviation
    if abs(value - mean) < 0.5 * aside:
        below, above = (_quadratic_tail(d, counts, mean + step) for step in (-aside, aside))
        return below + (above - below) * (value - mean + aside) / (2.0 * aside)
    t = _saddlepoint(d, counts, value)
    left = 1.0 - 2.0 * t * d
    exponent = t * value + 0.5 * float(counts @ np.log(left))
    w = copysign(sqrt(2.0 * max(exponent, 0.0)), t)
    v = t * sqrt(2.0 * float(counts @ (d / left) ** 2))
    return float(ndtr(-(w + log(v / w) / w)))


def _saddlepoint(d: Array, counts: Array, value: float) -> float:
    """Where the derivative of the cumulant function, ``sum(count d / (1 - 2 t d))``, is the value.

    It rises between ``1 / (2 min d)``, or minus infinity, and ``1 / (2 max d)``.
    """
    scale = float(np.abs(d).max())
    d, x = d / scale, value / scale
    high = 0.5 / float(d.max())
    low = 0.5 / float(d.min()) if d.min() < 0.0 else -float(counts.sum()) / max(x, 1e-300)
    for _ in range(_ROUNDS):
        t = np.linspace(low, high, _PARTS + 1)
        left = 1.0 - 2.0 * t[1:-1, None] * d
        if left.min() <= 0.0:
            break
        below = int(np.count_nonzero((d / left) @ counts < x))
        low, high = float(t[below]), float(t[below + 1])
    return 0.5 * (low + high) / scale
