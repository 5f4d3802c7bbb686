"""What a cause with a tuning would explain, at every tuning that is worth trying.

A cause with a tuning (the cycles of a gear ripple, the moment of a step) is a linear carrier times
functions of the pose, ``x(t) = sum_p f_p(t) J_p a``. Its score at a tuning needs three sums over the
poses p, each one matrix product for all tunings at once: with W what makes the rows independent, Q an
orthonormal basis of everything modelled and r the residual,

    z(t) = sum_p f_p(t) J_p^T (W^T r)_p ,   C(t) = sum_p f_p(t) J_p^T (W^T Q)_p ,
    S(t) = X^T X - C C^T ,   X^T X = sum over poses p, p' whose readings err together.

The score ``z^T (S + L^-2)^-1 z``, L the largest believable amplitudes, is that of
:mod:`calib.diagnosis.screen`: nothing is interpolated.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, IntArray
from calib.diagnosis.screen import VISIBLE
from calib.diagnosis.stage import Fit


@dataclass(frozen=True, eq=False)
class Beside:
    """What all scans of one fit share.

    g : ndarray, shape (m, R), the residual beside all that is modelled, brought back to the readings
    H : ndarray, shape (m, R, k), likewise an orthonormal basis of what is modelled
    """

    fit: Fit
    g: Array
    H: Array


def beside(fit: Fit) -> Beside:
    """Project everything modelled out of the residual of a fit."""
    (r, _), Q = fit.equations, fit.modelled
    left = r - Q @ (Q.T @ r)
    m, R = fit.r.shape
    g, H = left[: m * R].reshape(m, R), Q[: m * R].reshape(m, R, -1)
    if fit.mixing is not None:
        g, H = fit.mixing.back(g[..., None])[..., 0], fit.mixing.back(H)
    return Beside(fit, g, H)


def scores(
    around: Beside, carrier: Array, functions: Array, limits: Array
) -> tuple[Array, IntArray]:
    """Fall of the sum of squares at every tuning, (C,), and how many directions it takes, (C,).

    carrier : ndarray, shape (m, R, b), whitened rows of the carrier
    functions : ndarray, shape (C, m, f); limits : ndarray, shape (f b,), largest believable amplitudes
    """
    b, f = carrier.shape[-1], functions.shape[-1]
    g = np.einsum("mrb,mr->mb", carrier, around.g)
    H = np.einsum("mrb,mrk->mbk", carrier, around.H, optimize=True)
    z = _summed(functions, g[..., None])[..., 0]
    C = _summed(functions, H)
    S = _products(around, carrier, functions)
    lengths = np.sqrt(np.maximum(np.einsum("cii->ci", S), 0.0))
    S = S - C @ np.swapaxes(C, -1, -2)
    scale = np.where(lengths > 0.0, lengths, 1.0)
    d, V = np.linalg.eigh(S / (scale[:, :, None] * scale[:, None, :]))
    seen = d > VISIBLE**2
    # In the directions that can be seen: fall = z_U^T G (I + G)^-1 z_U, G their covariance a priori.
    T = V * np.where(seen, 1.0 / np.sqrt(np.where(seen, d, 1.0)), 0.0)[:, None, :]
    z_U = np.einsum("cik,ci->ck", T, z / scale)
    half = np.einsum("cik,ci,cij->ckj", T, 1.0 / scale, S, optimize=True) * limits
    G = half @ np.swapaxes(half, -1, -2)
    shrunk = np.linalg.solve(np.eye(b * f) + G, G @ z_U[..., None])[..., 0]
    return np.asarray((z_U * shrunk).sum(axis=-1)), np.asarray(seen.sum(axis=-1))


def _summed(functions: Array, at_poses: Array) -> Array:
    """``sum_p f_p(t) a_p``: functions (C, m, f) with a (m, b, k) to (C, f b, k)."""
    (C, m, f), (_, b, k) = functions.shape, at_poses.shape
    flat = np.swapaxes(functions, -1, -2).reshape(C * f, m) @ at_poses.reshape(m, b * k)
    return np.asarray(flat.reshape(C, f * b, k))


def _products(around: Beside, carrier: Array, functions: Array) -> Array:
    """``X^T X`` at every tuning, shape (C, f b, f b)."""
    (C, _, f), b = functions.shape, carrier.shape[2]
    total = np.zeros((C, f * b, f * b))
    for first, second, product in _pairs(around, carrier):
        pairs = functions[:, first, :, None] * functions[:, second, None, :]
        flat = pairs.swapaxes(1, 2).swapaxes(2, 3).reshape(C * f * f, -1)
        blocks = (flat @ product.reshape(len(first), -1)).reshape(C, f, f, b, b)
        total += blocks.swapaxes(2, 3).reshape(C, f * b, f * b)
    return total


def _pairs(around: Beside, carrier: Array) -> Iterator[tuple[IntArray, IntArray, Array]]:
    """Poses p and p' that err together, and ``J_p^T (W^T W)_pp' J_p'``, shape (pairs, b, b)."""
    mixing = around.fit.mixing
    if mixing is None:
        own = np.arange(len(carrier))
        yield own, own, np.swapaxes(carrier, -1, -2) @ carrier
        return
    for index, inverse in mixing.blocks:
        (B, r), R = index.shape, carrier.shape[1]
        mixed = inverse.reshape(B, r * R, r, R)  # rows by reading
        apart = np.einsum("Bxpr,Bprb->Bpxb", mixed, carrier[index], optimize=True)
        for i in range(r):
            for j in range(r):
                product = np.swapaxes(apart[:, i], -1, -2) @ apart[:, j]
                yield index[:, i], index[:, j], product
