"""Tests of columns beside a model: products of what is projected out of it, and what chance allows.

From columns X and the response r, whitened and with all modelled columns projected out, follow
``S = X^T X`` and ``z = X^T r``.
"""

from __future__ import annotations

import numpy as np

from calib.arrays import Array, IntArray, Mask
from calib.inference.tails import weighted_tail

VISIBLE = 1e-3
"""Share of a column's length that must remain beside the modelled columns for it to count."""


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
