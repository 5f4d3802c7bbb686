"""How strongly columns speak: by how much they would lower a sum of squares, under what is believed.

All of it follows from products of whitened columns X and a residual r, everything modelled projected
out: ``S = X^T X`` and ``z = X^T r``. In the directions U that can be seen, ``|U^T r|^2`` is the score
statistic, chi-square where nothing is missing (Rao, Proc. Camb. Phil. Soc. 44, 1948). Coefficients with
a prior lower the sum of squares by less; of those whose size is unknown the marginal likelihood speaks.

Where directions count by what a prior expects of them, the statistic is a weighted sum of chi-squares.
Its chance follows by the saddlepoint formula of Lugannani and Rice for a quadratic form (Kuonen,
Biometrika 86(4), 1999): the relative error stays small however far in the tail.
"""

from __future__ import annotations

from math import log, sqrt

import numpy as np

from calib.arrays import Array, IntArray, Mask

VISIBLE = 1e-3
"""Share of a column's length that must be left beside the modelled ones for it to count."""
_ROUNDS, _PARTS = 12, 32
_AT_THE_MEAN = 1e-3  # standard deviations from the mean within which the formula loses its digits


def visible_directions(S: Array, lengths: Array) -> tuple[Array, Mask]:
    """``T``, shape (..., k, k), that makes columns orthonormal directions ``X T``, and which are seen.

    S : ndarray, shape (..., k, k)
    lengths : ndarray, shape (..., k), of the columns before anything was projected out of them
    Directions that cannot be seen, (..., k) of bool tells which, are zero.
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


def along_prior(S: Array, z: Array, half: Array) -> tuple[Array, Array]:
    """Variances a priori of a signal along its principal axes, and the readings there, (..., k) each.

    S : ndarray, shape (..., k, k); z : ndarray, shape (..., k)
    half : ndarray, shape (..., k, k), ``half half^T`` the covariance a priori of the coefficients
    """
    back = np.swapaxes(half, -1, -2)
    d, axes = np.linalg.eigh(back @ S @ half)
    return d, (np.swapaxes(axes, -1, -2) @ (back @ z[..., None]))[..., 0]


def marginal_gain(d: Array, along: Array, squared: Array) -> tuple[Array, Array]:
    """Fall of the sum of squares by normal coefficients, and what their freedom costs, (...) each.

    d, along : ndarray, shape (..., k), as of :func:`along_prior`; squared : ndarray, shape (..., 1),
        factors of the variances. The difference is that of -2 log marginal likelihood.
    """
    wide = squared * d
    return (squared * along**2 / (1.0 + wide)).sum(axis=-1), np.log1p(wide).sum(axis=-1)


def cholesky_of(spread: Array) -> Array:
    """Lower factor of a covariance (k, k), of rank less than k as well."""
    jitter = 1e-9 * float(np.diag(spread).mean()) * np.eye(len(spread))
    return np.asarray(np.linalg.cholesky(spread + jitter))


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
