"""Predicted residuals of groups that are left out of a linear fit, without any refit.

With ``A = X^T X`` of all rows and prior rows, the fit without the rows ``X_f`` has ``A - X_f^T X_f``,
and its error at them is ``e_f + X_f (A - X_f^T X_f)^-1 X_f^T e_f``, e the residual of the whole fit.
Orthonormal columns make A the identity.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, IntArray, Mask, by_size
from calib.inference.least_squares import independent_columns, inverse_triangle, joined_triangle

_DETERMINED = 1e-8  # share of a direction's information that the other groups must hold
_TINY = 1e-300


@dataclass(frozen=True, eq=False)
class LeftOut:
    """Errors of rows as the fit without their group predicts them.

    residual : ndarray, of the shape and unit of the rows
    spread : ndarray, shape (N, <= f), root of the covariance of those predictions within a group, for
        rows of unit variance
    growth : ndarray, shape (g,), by sorted group: ratio of the variance of those predictions to that of
        the whole fit's
    determined : ndarray of bool, shape (g,), by sorted group: whether the other groups determine all
        that the group depends on. Where they do not, those directions keep the value of the whole fit.
    """

    residual: Array
    spread: Array
    growth: Array
    determined: Mask


def leave_groups_out(
    X: Array,
    y: Array,
    group: IntArray,
    prior: Array | None = None,
    least: float = _DETERMINED,
) -> LeftOut:
    """Leave out each group of rows in turn.

    X : ndarray, shape (N, f), y : ndarray, shape (N,), rows of equal variance
    group : ndarray of int, shape (N,); prior : ndarray, shape (h, f), further rows, of values zero
    least : share of a direction's information that the other groups must hold
    """
    f = X.shape[1]
    rows = np.column_stack([X, y])
    held = np.zeros((0, f + 1)) if prior is None else np.pad(prior, ((0, 0), (0, 1)))
    R = joined_triangle([rows, held])
    kept = independent_columns(R[:, :f])
    R = joined_triangle([part[:, np.append(kept, f)] for part in (rows, held)])
    Q = X[:, kept] @ inverse_triangle(R[:-1, :-1])
    e = y - Q @ R[:-1, -1]
    number = np.unique(group, return_inverse=True)[1].reshape(-1)
    left, spread = e.copy(), np.zeros_like(Q)
    growth = np.ones(int(number.max(initial=-1)) + 1)
    determined = np.ones(len(growth), dtype=bool)
    for index in by_size(number) if len(number) else ():
        of, few = number[index[:, 0]], index.shape[1] < Q.shape[1]
        own, back = Q[index], np.swapaxes(Q[index], -1, -2)
        h, axes = np.linalg.eigh(own @ back if few else back @ own)
        h = np.clip(h, 0.0, 1.0)
        known = 1.0 - h > least
        gained = np.where(known, 1.0 / np.where(known, 1.0 - h, 1.0), 0.0)
        determined[of] = known.all(axis=1)
        growth[of] = (h * gained).sum(axis=1) / np.maximum(h.sum(axis=1), _TINY)
        root = (
            axes * np.sqrt(h * gained)[:, None] if few else own @ (axes * np.sqrt(gained)[:, None])
        )
        left[index] += (root @ (np.swapaxes(root, -1, -2) @ e[index][..., None]))[..., 0]
        spread[index, : root.shape[-1]] = root
    return LeftOut(left, spread, growth, determined)
