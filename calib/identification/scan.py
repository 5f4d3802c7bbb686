"""What a cause with a tuning would explain, at every tuning that is worth trying.

A cause with a tuning (the cycles of a gear ripple, the moment of a step) is a linear carrier times
functions of the pose, ``x(t) = sum_p f_p(t) J_p a``. Its score at a tuning needs three sums over the
poses p, each one matrix product for all tunings at once: with W what makes the rows independent, Q an
orthonormal basis of everything modelled and r the residual,

    z(t) = sum_p f_p(t) J_p^T (W^T r)_p ,   C(t) = sum_p f_p(t) J_p^T (W^T Q)_p ,
    S(t) = X^T X - C C^T ,   X^T X = sum_p f_p(t)^2 J_p^T J_p - sum_g (sum_p f_p(t) G_p^T J_p)^2 ,

the last over groups g of poses whose readings err together, ``W^T W = I - sum_g G G^T``. The score
``z^T (S + L^-2)^-1 z``, L the largest believable amplitudes, is that of
:func:`calib.inference.evidence.score_test`: nothing is interpolated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, IntArray, by_size
from calib.inference.evidence import score_test
from calib.observations.linear import Complement

_AT_ONCE = 400  # tunings: memory


@dataclass(frozen=True, eq=False)
class Carried:
    """Products of a carrier's columns with residual and model, pose by pose.

    g : ndarray, shape (m, b), with the residual; H : ndarray, shape (m, b, k), with the model's basis
    squares : ndarray, shape (m, b, b), with the carrier itself
    groups : tuple of (poses (B, r), ndarray, shape (B, r, k, b)), that err together: the squares of
        their sums are taken off again
    """

    g: Array
    H: Array
    squares: Array
    groups: tuple[tuple[IntArray, Array], ...]


def carried(beside: Complement, carrier: Array) -> Carried:
    """What all scans with one carrier share; carrier : ndarray, shape (m, R, b), whitened rows."""
    back, mixing = np.swapaxes(carrier, -1, -2), beside.mixing
    g, H = beside.at_readings
    squares, shared = back @ carrier, []
    if mixing is not None:
        squares = squares / mixing.scale**2
        for groups, G in mixing.shared:
            each = np.swapaxes(G, -1, -2) @ carrier / mixing.scale
            if groups.alone:
                squares -= np.swapaxes(each, -1, -2) @ each
            else:
                shared += [(index, each[index]) for index in by_size(groups.number)]
    return Carried((back @ g[..., None])[..., 0], back @ H, squares, tuple(shared))


def times(carrier: Array, functions: Array) -> Array:
    """Rows (m, R, f b) of a carrier's (m, R, b) times functions of the pose (m, f)."""
    rows = carrier[:, :, None, :] * functions[:, None, :, None]
    return np.asarray(rows.reshape((*carrier.shape[:2], -1)))


def falls(carried: Carried, functions: Array, limits: Array) -> Array:
    """Fall of the sum of squares at every tuning, shape (C,).

    functions : ndarray, shape (C, m, f); limits : ndarray, shape (f b,), largest believable amplitudes
    """
    score = np.zeros(len(functions))
    for start in range(0, len(functions), _AT_ONCE):
        part = slice(start, start + _AT_ONCE)
        F = np.ascontiguousarray(np.swapaxes(functions[part], -1, -2))
        z = _summed(F, carried.g[..., None])[..., 0]
        C, S = _summed(F, carried.H), _products(F, carried)
        lengths = np.sqrt(np.maximum(np.diagonal(S, axis1=-2, axis2=-1), 0.0))
        score[part], _ = score_test(S - C @ np.swapaxes(C, -1, -2), z, lengths, limits)
    return score


def _summed(F: Array, at_poses: Array) -> Array:
    """``sum_p f_p(t) a_p``: functions (C, f, m) with a (m, b, k) to (C, f b, k)."""
    (C, f, m), (_, b, k) = F.shape, at_poses.shape
    flat = F.reshape(C * f, m) @ at_poses.reshape(m, b * k)
    return np.asarray(flat.reshape(C, f * b, k))


def _products(F: Array, carried: Carried) -> Array:
    """``X^T X`` at every tuning, shape (C, f b, f b), of functions (C, f, m)."""
    (C, f, m), b = F.shape, carried.g.shape[1]
    flat = (F[:, :, None] * F[:, None, :]).reshape(C * f * f, m) @ carried.squares.reshape(m, b * b)
    total = np.swapaxes(flat.reshape(C, f, f, b, b), 2, 3).reshape(C, f * b, f * b)
    for index, shared in carried.groups:
        B, r, k, _ = shared.shape
        functions = np.moveaxis(F[..., index], 2, 0).reshape(B, C * f, r)
        sums = (functions @ shared.reshape(B, r, k * b)).reshape(B, C, f, k, b)
        sums = np.moveaxis(sums, (0, 3), (1, 2)).reshape(C, B * k, f * b)
        total -= np.swapaxes(sums, -1, -2) @ sums
    return np.asarray(total)
