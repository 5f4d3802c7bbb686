"""Chances of a weighted sum of squares of normal variables.

The saddlepoint formula of Lugannani and Rice for a quadratic form (Kuonen, Biometrika 86(4), 1999): its
relative error stays small however far in the tail.
"""

from __future__ import annotations

from math import log, sqrt

import numpy as np

from calib.arrays import Array

_ROUNDS, _PARTS = 12, 32
_AT_THE_MEAN = 1e-3  # standard deviations from the mean within which the formula loses its digits


def chance_above(weights: Array, value: float) -> float:
    """Probability that ``sum(weights * z^2)`` with standard normal z exceeds a value.

    weights : ndarray, shape (k,), of any sign, not all zero
    """
    from scipy.special import ndtr

    mean, deviation = float(weights.sum()), sqrt(2.0 * float((weights**2).sum()))
    if value <= 0.0 and weights.min() >= 0.0:
        return 1.0
    if value >= 0.0 and weights.max() <= 0.0:
        return 0.0
    aside = 2.0 * _AT_THE_MEAN * deviation
    if abs(value - mean) < 0.5 * aside:
        below, above = (chance_above(weights, mean + step) for step in (-aside, aside))
        return below + (above - below) * (value - mean + aside) / (2.0 * aside)
    t = _saddlepoint(weights, value)
    left = 1.0 - 2.0 * t * weights
    w = float(np.sign(t)) * sqrt(2.0 * max(t * value + 0.5 * float(np.log(left).sum()), 0.0))
    v = t * sqrt(2.0 * float(((weights / left) ** 2).sum()))
    return float(ndtr(-(w + log(v / w) / w)))


def ratio_above(weights: Array, dof: int, value: float) -> float:
    """Probability that ``sum(weights * z^2)`` exceeds a share of the sum of all dof squares.

    weights : ndarray, shape (k,), of the first k of the dof variables
    value : float, the share times dof, so that large dof make it a sum that exceeds the value
    """
    share = value / dof
    rest = np.full(max(dof - len(weights), 0), -share)
    return chance_above(np.concatenate([weights - share, rest]), 0.0)


def _saddlepoint(weights: Array, value: float) -> float:
    """Where the derivative of the cumulant function is the value: ever finer parts.

    The derivative rises from minus to plus infinity (from zero where weights have one sign) between
    ``1 / (2 min)`` and ``1 / (2 max)`` of the weights.
    """
    scale = float(np.abs(weights).max())
    d, x = weights / scale, value / scale
    high = 0.5 / float(d.max()) if d.max() > 0.0 else _beyond(d, x, 1.0)
    low = 0.5 / float(d.min()) if d.min() < 0.0 else _beyond(d, x, -1.0)
    for _ in range(_ROUNDS):
        t = np.linspace(low, high, _PARTS + 1)
        left = 1.0 - 2.0 * t[1:-1, None] * d
        if left.min() <= 0.0:
            break
        below = int(np.count_nonzero((d / left).sum(axis=1) < x))
        low, high = float(t[below]), float(t[below + 1])
    return 0.5 * (low + high) / scale


def _beyond(d: Array, x: float, side: float) -> float:
    """A point so far out that the derivative is nearer zero than the value."""
    t = side
    while abs(float((d / (1.0 - 2.0 * t * d)).sum())) > 0.5 * abs(x):
        t *= 2.0
    return t
