"""Ridge regression of the constants that posecal keeps, its one penalty by cross-validation.

Errors of 1 mm and of 1 mrad are penalised alike, base and markers not at all. The problem is linearised
anew at each solution; the model's Jacobian is posecal's.
"""

from __future__ import annotations

import numpy as np

from calib.arrays import Array, IntArray
from calib.effects.base import Base
from calib.effects.tool import Tool
from calib.identification.start import initial_values
from calib.model import Model
from calib.poses import Measurements

FOLDS = 10
_UNIT = 1e-3  # m and rad
_PENALTIES = 1.0 / np.logspace(-2.5, 3.0, 45) ** 2  # of squared units, in squared units of the rows
_ROUNDS, _CHOICES = 20, 4  # linearisations, and those at which the penalty is chosen anew
_SETTLED = 1e-12  # m and rad


def ridge(model: Model, data: Measurements, sigma: float, rng: np.random.Generator) -> Array:
    """Values of the parameters, shape (p,), SI; sigma : m, by which rows are divided."""
    folds = np.array_split(rng.permutation(len(data)), min(FOLDS, len(data)))
    return _solved(model, data, sigma, folds)


def exact_values(model: Model, data: Measurements) -> tuple[Array, float]:
    """Values without any penalty, and the RMS of what they leave, m."""
    values = _solved(model, data, 1.0, None)
    off = model.off(values, data)
    return values, float(np.sqrt(np.mean(np.sum(off**2, axis=-1))))


def _solved(model: Model, data: Measurements, sigma: float, folds: list[IntArray] | None) -> Array:
    """From the readings' own first values on, until a step moves nothing."""
    values = initial_values(model, data)
    placed = np.zeros(len(values), dtype=bool)
    placed[model.where(Base, Tool)] = True
    penalties = np.zeros(1)
    for count in range(_ROUNDS):
        predicted, J = model.jacobian(values, data.poses)
        own = np.where(placed, 0.0, values)
        y = (data.readings - predicted + J @ own) / sigma
        # Poses first, so that a fold takes its rows with it.
        A, B = J[..., placed] / sigma, J[..., ~placed] * (_UNIT / sigma)
        if folds is not None and count < _CHOICES:
            penalties = _PENALTIES[[int(np.argmin(_unseen(A, B, y, folds)))]]
        step, sizes = (found[0] for found in _fits(A, B, y, penalties))
        new = values.copy()
        new[placed] += step
        new[~placed] = _UNIT * sizes
        moved, values = np.abs(new - values).max(), new
        if moved < _SETTLED and count >= _CHOICES:
            break
    return values


def _unseen(A: Array, B: Array, y: Array, folds: list[IntArray]) -> Array:
    """Squares that folds which took no part leave under each penalty, shape (k,)."""
    total = np.zeros(len(_PENALTIES))
    for fold in folds:
        kept = np.setdiff1d(np.arange(len(y)), fold)
        step, sizes = _fits(A[kept], B[kept], y[kept], _PENALTIES)
        off = y[fold] - np.moveaxis(A[fold] @ step.T + B[fold] @ sizes.T, -1, 0)
        total += (off**2).sum(axis=(1, 2, 3))
    return total


def _fits(A: Array, B: Array, y: Array, penalties: Array) -> tuple[Array, Array]:
    """Free values (k, a) and penalised ones (k, b) that fit y, one row a penalty."""
    A, B, y = A.reshape(-1, A.shape[-1]), B.reshape(-1, B.shape[-1]), y.ravel()
    free = np.linalg.qr(A)[0]
    U, s, Vt = np.linalg.svd(B - free @ (free.T @ B), full_matrices=False)
    gain = s / (s**2 + np.where(s > 0.0, penalties[:, None], 1.0))
    sizes = (gain * (U.T @ (y - free @ (free.T @ y)))) @ Vt
    rest = y[:, None] - B @ sizes.T
    return np.linalg.lstsq(A, rest, rcond=None)[0].T, sizes
