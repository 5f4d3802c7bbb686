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

    def carried(self, carrier: Array) -> Carried:
        """What all scans with one carrier share; carrier : ndarray, shape (m, R, b), whitened rows."""
        back = np.swapaxes(carrier, -1, -2)
        g, H = (back @ self.g[..., None])[..., 0], back @ self.H
        return Carried(g, H, tuple(_pairs(self.fit, carrier)))


@dataclass(frozen=True, eq=False)
class Carried:
    """A carrier beside what is modelled, pose by pose.

    g : ndarray, shape (m, b), its products with the residual; H : ndarray, shape (m, b, k), with the
        basis of what is modelled
    pairs : tuple of (poses (P,), poses (P,), products (P, b, b)), of poses that err together
    """

    g: Array
    H: Array
    pairs: tuple[tuple[IntArray, IntArray, Array], ...]


def beside(fit: Fit) -> Beside:
    """Project everything modelled out of the residual of a fit."""
    (r, _), Q = fit.equations, fit.modelled
    left = r - Q @ (Q.T @ r)
    m, R = fit.r.shape
    g, H = left[: m * R].reshape(m, R), Q[: m * R].reshape(m, R, -1)
    if fit.mixing is not None:
        g, H = fit.mixing.back(g[..., None])[..., 0], fit.mixing.back(H)
    return Beside(fit, g, H)


def scores(carried: Carried, functions: Array, limits: Array) -> tuple[Array, IntArray]:
    """Fall of the sum of squares at every tuning, (C,), and how many directions it takes, (C,).

    functions : ndarray, shape (C, m, f); limits : ndarray, shape (f b,), largest believable amplitudes
    """
    F = np.ascontiguousarray(np.swapaxes(functions, -1, -2))
    z = _summed(F, carried.g[..., None])[..., 0]
    C, S = _summed(F, carried.H), _products(F, carried)
    lengths = np.sqrt(np.maximum(np.diagonal(S, axis1=-2, axis2=-1), 0.0))
    S = S - C @ np.swapaxes(C, -1, -2)
    scale = np.where(lengths > 0.0, lengths, 1.0)
    d, V = np.linalg.eigh(S / (scale[:, :, None] * scale[:, None, :]))
    seen = d > VISIBLE**2
    # In the directions that can be seen: fall = z_U^T G (I + G)^-1 z_U, G their covariance a priori.
    T = V * np.where(seen, 1.0 / np.sqrt(np.where(seen, d, 1.0)), 0.0)[:, None, :]
    Tt = np.swapaxes(T / scale[:, :, None], -1, -2)
    z_U, half = Tt @ z[..., None], Tt @ S * limits
    G = half @ np.swapaxes(half, -1, -2)
    shrunk = np.linalg.solve(np.eye(len(limits)) + G, G @ z_U)
    return np.asarray((z_U * shrunk).sum(axis=(-1, -2))), np.asarray(seen.sum(axis=-1))


def _summed(F: Array, at_poses: Array) -> Array:
    """``sum_p f_p(t) a_p``: functions (C, f, m) with a (m, b, k) to (C, f b, k)."""
    (C, f, m), (_, b, k) = F.shape, at_poses.shape
    flat = F.reshape(C * f, m) @ at_poses.reshape(m, b * k)
    return np.asarray(flat.reshape(C, f * b, k))


def _products(F: Array, carried: Carried) -> Array:
    """``X^T X`` at every tuning, shape (C, f b, f b), of functions (C, f, m)."""
    (C, f, _), b = F.shape, carried.g.shape[1]
    total = np.zeros((C, f, b, f, b))
    for first, second, product in carried.pairs:
        pairs = F[:, :, None, first] * F[:, None, :, second]
        flat = pairs.reshape(C * f * f, -1) @ product.reshape(len(first), -1)
        total += np.swapaxes(flat.reshape(C, f, f, b, b), 2, 3)
    return total.reshape(C, f * b, f * b)


def _pairs(fit: Fit, carrier: Array) -> Iterator[tuple[IntArray, IntArray, Array]]:
    """Poses p and p' that err together, and ``J_p^T (W^T W)_pp' J_p'``, shape (P, b, b)."""
    if fit.mixing is None:
        own = np.arange(len(carrier))
        yield own, own, np.swapaxes(carrier, -1, -2) @ carrier
        return
    R = carrier.shape[1]
    for index, inverse in fit.mixing.blocks:
        readings = range(index.shape[1])
        apart = [inverse[..., p * R : (p + 1) * R] @ carrier[index[:, p]] for p in readings]
        for i in readings:
            for j in readings:
                yield index[:, i], index[:, j], np.swapaxes(apart[i], -1, -2) @ apart[j]
