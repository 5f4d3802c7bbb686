"""Weighted score tests: what counts is a sum of squares weighted by what a prior expects.

Of columns X whose coefficients are a priori normal with covariance C, d are the eigenvalues of
``X C X^T`` and z the residual along its vectors. The statistic is ``sum(w z^2)``, with
``w = d / (1 + d)`` in units of a noise: directions that what is modelled absorbs weigh nothing, where a
chi-square would give all the same. Its chance is that of a weighted sum of chi-squares, by the
saddlepoint formula of Lugannani and Rice for a quadratic form (Kuonen, Biometrika 86(4), 1999): its
relative error stays small however far in the tail.
"""

from __future__ import annotations

from math import log, sqrt

import numpy as np

from calib.arrays import Array, IntArray
from calib.diagnosis.screen import Field
from calib.evidence import VISIBLE, along_prior, cholesky_of

_ROUNDS, _PARTS = 12, 32
_AT_THE_MEAN = 1e-3  # standard deviations from the mean within which the formula loses its digits


def weighted_test(
    field: Field, columns: IntArray, spread: Array, mean: bool = False
) -> tuple[float, float]:
    """Probability of as much of some columns (k,) by chance, and by how much the sum of squares falls.

    spread : ndarray, shape (k, k), covariance of their coefficients a priori
    mean : whether they are weighed against the mean of d, a signal about as large as the noise with
        which the data determine it; else against the noise
    """
    d, along = along_prior(*field.products(columns), cholesky_of(spread))
    longest = float((field.lengths[columns] ** 2).max(initial=0.0))
    seen = d > VISIBLE**2 * float(spread.diagonal().mean()) * longest
    if not seen.any() or field.dof <= np.count_nonzero(seen):
        return 1.0, 0.0
    d = d[seen]
    squares = along[seen] ** 2 / d
    w = d / (d + (d.mean() if mean else field.spread))
    statistic = float(w @ squares) / field.spread
    chance = (
        ratio_above(w, field.dof, statistic) if field.noise_refuted else chance_above(w, statistic)
    )
    return chance, float(squares.sum())


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
