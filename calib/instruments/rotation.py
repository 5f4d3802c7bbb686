"""The rotation of least squares whose nine entries stand in linear equations.

Newton's method on the rotations, from many starts at once: residuals of a wrong arm are large, and
steps by first derivatives alone would be several times as many.
"""

from __future__ import annotations

import numpy as np

from calib.arm.se3 import nearest_rotation, rotate, skew, so3_exp
from calib.arrays import Array
from calib.solver import normal_equations

_STARTS = 256
_FOLLOWED = 12  # the best of them
_STEPS = 60
_DAMPING = (1e-3, 1e-12, 1e12)  # start, smallest, largest; relative to the largest curvature
_LIGHT = 1e-3  # damping up to which a short step means a minimum
_SHORT = 1e-6  # share of a standard deviation
_CURVED = np.finfo(float).tiny  # at least, so that a flat form stays where it is


def rotation(factor: Array, target: Array) -> Array:
    """The S in SO(3) that minimises ``|target - factor S|``.

    factor : ndarray, shape (k, 9), on the entries of S row by row; target : ndarray, shape (k,); both
        in standard deviations
    """
    free = np.asarray(np.linalg.lstsq(factor, target, rcond=1e-9)[0]).reshape(3, 3)
    starts = np.concatenate([nearest_rotation(free)[None], _anyhow(_STARTS - 1)])
    cost = np.sum((target - starts.reshape(-1, 9) @ factor.T) ** 2, axis=-1)
    found, cost = _descended(factor, target, starts[np.argsort(cost)[:_FOLLOWED]])
    return np.asarray(found[int(np.argmin(cost))])


def _anyhow(count: int) -> Array:
    """Rotations (count, 3, 3) spread evenly, of quaternions of any direction."""
    q = np.random.default_rng(0).normal(size=(count, 4))
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    sine = np.linalg.norm(q[:, 1:], axis=-1, keepdims=True)
    return so3_exp(2.0 * np.arctan2(sine, q[:, :1]) * q[:, 1:] / sine)


def _descended(factor: Array, target: Array, S: Array) -> tuple[Array, Array]:
    """Minima (n, 3, 3) near rotations S (n, 3, 3) and their squared residuals (n,)."""
    by_entry = np.einsum("fab,kcb->acfk", factor.reshape(-1, 3, 3), skew(np.eye(3))).reshape(9, -1)
    cost, g, H = _second_order(factor, target, by_entry, S)
    damping, done = np.full(len(S), _DAMPING[0]), np.zeros(len(S), dtype=bool)
    for _ in range(_STEPS):
        curvature, V = np.linalg.eigh(H)
        curvature = np.abs(curvature)  # which leads away from a saddle
        curvature += damping[:, None] * curvature.max(axis=-1, keepdims=True) + _CURVED
        step = rotate(V, rotate(np.swapaxes(V, -1, -2), g) / curvature)
        trial = S @ so3_exp(step)
        new_cost, new_g, new_H = _second_order(factor, target, by_entry, trial)
        promised = np.sum(step * g, axis=-1)
        short = (damping <= _LIGHT) & (promised <= _SHORT**2 * np.maximum(1.0, cost / 3.0))
        better = (new_cost <= cost) & ~done
        done |= short | (damping >= _DAMPING[2])
        damping = np.clip(damping * np.where(better, 0.1, 10.0), *_DAMPING[1:])
        S, H = (np.where(better[:, None, None], a, b) for a, b in ((trial, S), (new_H, H)))
        cost, g = np.where(better, new_cost, cost), np.where(better[:, None], new_g, g)
        if done.all():
            break
    return S, cost


def _second_order(
    factor: Array, target: Array, by_entry: Array, S: Array
) -> tuple[Array, Array, Array]:
    """Cost (n,), gradient (n, 3) and curvature (n, 3, 3) of half of it, by w of ``S exp(w)``.

    by_entry : ndarray, shape (9, 3 k), what S makes of the first derivatives, ``factor S skew(e_i)``
    Of second ones, ``e_j e_i^T - delta_ij I`` is the product of two such matrices.
    """
    flat = S.reshape(-1, 9)
    left = target - flat @ factor.T
    cost, g, H = normal_equations(left, (flat @ by_entry).reshape(len(S), -1, 3))
    pull = np.swapaxes(S, -1, -2) @ (left @ factor).reshape(-1, 3, 3)
    trace = np.trace(pull, axis1=-2, axis2=-1)[:, None, None] * np.eye(3)
    return cost, g, H + trace - (pull + np.swapaxes(pull, -1, -2)) / 2.0
