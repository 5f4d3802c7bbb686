"""How much likelier a Gaussian block makes the rows: its gain in restricted likelihood.

From columns ``Y = X R`` of a block and the response, whitened and with all modelled columns projected
out, follow ``S = Y^T Y = U diag(d) U^T`` and ``z = U^T Y^T e``. At amplitude a the block lowers
-2 log L by

    gain(a) = sum_j a^2 z_j^2 / (1 + a^2 d_j) - log(1 + a^2 d_j)

The test of its presence weighs the directions as its root does, at its stated amplitude or at one:
``sum_j w_j z_j^2 / d_j`` with ``w_j = a^2 d_j / (1 + a^2 d_j)`` is a weighted sum of chi-square
variables where the block is absent, whatever amplitude the rows suggest.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, IntArray, Mask
from calib.inference.tails import weighted_tail

VISIBLE = 1e-3
"""Share of a column's length that must remain beside the modelled columns for it to count."""
_ROUNDS, _PARTS = 5, 48
_SMALLEST = 1e-6  # of the largest squared amplitude that is considered


@dataclass(frozen=True)
class Evidence:
    """What the rows say of a block.

    gain : float, decrease of -2 log restricted likelihood at the amplitude
    amplitude : float, stated or best; zero where no amplitude gains
    directions : int, combinations of its columns that the model leaves visible
    p : float, probability of as large a test statistic where the block is absent
    """

    gain: float
    amplitude: float
    directions: int
    p: float


def block_evidence(
    Y: Array,
    lengths: Array,
    e: Array,
    mean: Array,
    amplitude: float | None,
    freedom: float,
) -> Evidence:
    """Evidence of a block.

    Y : ndarray, shape (N, l), whitened and projected columns ``X R``; lengths : (l,), before projection
    e : ndarray, shape (N,), response and mean : ndarray, shape (N,), rows ``X m``, likewise
    amplitude : float, or None for the best; freedom : float, degrees of freedom of ``|e|^2``
    """
    d, axes = np.linalg.eigh(Y.T @ Y)
    seen = d > VISIBLE**2 * np.max(lengths**2, initial=0.0)
    d, axes = d[seen], axes[:, seen]
    left = e - mean
    shift = float(mean @ (e + left))
    squares = (axes.T @ (Y.T @ left)) ** 2
    size, gain = _best(d, squares) if amplitude is None else (amplitude**2, 0.0)
    if amplitude is not None:
        gain = float(_gain(d, squares, np.array([size]))[0])
    face = 1.0 if amplitude is None else amplitude**2
    plain = (axes.T @ (Y.T @ e)) ** 2
    statistic = float((face * plain / (1.0 + face * d)).sum())
    noise = float(e @ e) / freedom if np.isfinite(freedom) else 1.0
    p = weighted_tail(face * d / (1.0 + face * d), statistic / max(noise, 1e-300), freedom)
    return Evidence(shift + gain, float(np.sqrt(size)), int(seen.sum()), p)


def _gain(d: Array, squares: Array, sizes: Array) -> Array:
    """Gain at each of some squared amplitudes, shape (n,)."""
    a = sizes[:, None]
    return np.asarray((a * squares / (1.0 + a * d) - np.log1p(a * d)).sum(axis=1))


def _best(d: Array, squares: Array) -> tuple[float, float]:
    """The squared amplitude of the largest gain, and that gain; zero where none is positive.

    Beyond ``max z^2 / d^2`` every direction only loses.
    """
    high = float((squares / d**2).max(initial=0.0))
    if high <= 0.0:
        return 0.0, 0.0
    sizes = np.geomspace(_SMALLEST * high, high, _PARTS)
    for _ in range(_ROUNDS):
        best = int(np.argmax(_gain(d, squares, sizes)))
        size = float(sizes[best])
        ends = sizes[max(best - 1, 0)], sizes[min(best + 1, len(sizes) - 1)]
        sizes = np.geomspace(*ends, _PARTS)
    gain = float(_gain(d, squares, np.array([size]))[0])
    return (size, gain) if gain > 0.0 else (0.0, 0.0)


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


def cholesky_of(spread: Array) -> Array:
    """Lower factor of a covariance (k, k), of rank less than k as well."""
    jitter = 1e-9 * float(np.diag(spread).mean()) * np.eye(len(spread))
    return np.asarray(np.linalg.cholesky(spread + jitter))


def weighted_test(
    S: Array, z: Array, lengths: Array, spread: Array, freedom: float = np.inf
) -> tuple[float, float]:
    """Probability of as much of some columns by chance, and by how much the sum of squares falls.

    S, z : ndarray, shapes (k, k) and (k,), products of columns and residual, all modelled projected out
    lengths : ndarray, shape (k,), of the columns before; spread : ndarray, shape (k, k), covariance of
        their coefficients a priori, by which directions weigh
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
