"""Tests of columns beside a model: what is projected out of it, and what chance allows.

From columns X and the response r, whitened and with all modelled columns projected out, follow
``S = X^T X`` and ``z = X^T r``.
"""

from __future__ import annotations

from math import copysign, log, sqrt

import numpy as np

from calib.arrays import Array, IntArray, Mask

VISIBLE = 1e-3
"""Share of a column's length that must remain beside the modelled columns for it to count."""
_ROUNDS, _PARTS = 12, 32
_AT_THE_MEAN = 1e-3  # standard deviations from the mean within which the formula loses its digits
_EQUAL = 1e-9  # relative difference of weights


def visible_directions(S: Array, lengths: Array) -> tuple[Array, Mask]:
    """``T``, shape (..., k, k), that makes columns orthonormal directions ``X T``, and which are seen.

    S : ndarray, shape (..., k, k)
    lengths : ndarray, shape (..., k), of the columns before anything was projected out of them
    Directions that cannot be seen, by the mask (..., k), are zero.
    """
    scale = np.where(lengths > 0.0, lengths, 1.0)
    d, V = np.linalg.eigh(S / (scale[..., :, None] * scale[..., None, :]))
    seen = d > VISIBLE**2
    root = np.where(seen, 1.0 / np.sqrt(np.where(seen, d, 1.0)), 0.0)
    return V * root[..., None, :] / scale[..., :, None], seen


def score_test(
    S: Array, z: Array, lengths: Array, limits: Array | None = None
) -> tuple[Array, IntArray]:
    """Fall of the sum of squares, shape (...), and how many directions it takes.

    S, z : of columns (..., k); lengths : as of :func:`visible_directions`
    limits : ndarray, shape (..., k), standard deviations a priori of the coefficients; any without
    Of what the readings ask for counts what the plausible sizes can give: with G the covariance a
    priori of the signal in the directions U, ``fall = z_U^T G (I + G)^-1 z_U``.
    """
    T, seen = visible_directions(S, lengths)
    Tt = np.swapaxes(T, -1, -2)
    along = given = Tt @ z[..., None]
    if limits is not None:
        half = Tt @ S * limits[..., None, :]
        G = half @ np.swapaxes(half, -1, -2)
        given = np.asarray(np.linalg.solve(np.eye(G.shape[-1]) + G, G @ along), dtype=np.float64)
    return np.asarray((along * given).sum(axis=(-1, -2))), np.asarray(seen.sum(axis=-1))


def cholesky_of(spread: Array) -> Array:
    """Lower factor of a covariance (k, k), of rank less than k as well."""
    jitter = 1e-9 * float(np.diag(spread).mean()) * np.eye(len(spread))
    return np.asarray(np.linalg.cholesky(spread + jitter))


def weighted_test(
    S: Array, z: Array, lengths: Array, spread: Array, freedom: float = np.inf
) -> tuple[float, float]:
    """Probability of as much of some columns by chance, and by how much the sum of squares falls.

    S, z, lengths : of columns (k,), as of :func:`score_test`
    spread : ndarray, shape (k, k), covariance of their coefficients a priori, by which directions weigh
    freedom : degrees of freedom of the residual where its size says what the noise is
    """
    half = cholesky_of(spread)
    d, axes = np.linalg.eigh(half.T @ S @ half)
    seen = d > VISIBLE**2 * float(spread.diagonal().mean()) * float((lengths**2).max(initial=0.0))
    if not seen.any() or freedom <= np.count_nonzero(seen):
        return 1.0, 0.0
    d, squares = d[seen], (axes.T @ (half.T @ z))[seen] ** 2 / d[seen]
    w = d / (1.0 + d)
    return weighted_tail(w, float(w @ squares), freedom), float(squares.sum())


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
