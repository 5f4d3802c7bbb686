"""How strongly columns speak: by how much they would lower a sum of squares, under what is believed.

All of it follows from products of whitened columns X and a residual r, everything modelled projected
out: ``S = X^T X`` and ``z = X^T r``. In the directions U that can be seen, ``|U^T r|^2`` is the score
statistic, chi-square where nothing is missing (Rao, Proc. Camb. Phil. Soc. 44, 1948). Coefficients with
a prior lower the sum of squares by less; of those whose size is unknown the marginal likelihood speaks.
"""

from __future__ import annotations

import numpy as np

from calib.arrays import Array, IntArray, Mask

VISIBLE = 1e-3
"""Share of a column's length that must be left beside the modelled ones for it to count."""


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
