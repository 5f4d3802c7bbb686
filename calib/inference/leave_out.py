"""Predicted residuals of groups that are left out of a linear fit, without any refit.

With orthonormal columns Q of all rows, the fit without the rows ``Q_f`` errs at them by
``e_f + Q_f (I - Q_f^T Q_f)^-1 Q_f^T e_f``, e the residual of the whole fit.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from calib.arrays import Array, IntArray, Mask, by_size
from calib.inference.least_squares import independent_columns, inverse_triangle, joined_triangle

_TINY = 1e-300


class LeftOut(NamedTuple):
    """Errors of rows as the fit without their group predicts them.

    residual : ndarray, shape (N,), in the unit of the rows
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


def leave_groups_out(X: Array, y: Array, group: IntArray, least: float = 1e-8) -> LeftOut:
    """Leave out each group of rows in turn.

    X : ndarray, shape (N, f), y : ndarray, shape (N,), rows of equal variance
    group : ndarray of int, shape (N,)
    least : share of a direction's information that the other groups must hold
    """
    kept = independent_columns(joined_triangle([X]))
    R = joined_triangle([np.column_stack([X[:, kept], y])])
    Q = X[:, kept] @ inverse_triangle(R[:-1, :-1])
    e = y - Q @ R[:-1, -1]
    number = np.unique(group, return_inverse=True)[1].reshape(-1)
    left, spread, growth = e.copy(), np.zeros_like(Q), np.ones(int(number.max(initial=-1)) + 1)
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
        root = axes * np.sqrt((h if few else 1.0) * gained)[:, None]
        root = root if few else own @ root
        left[index] += (root @ (np.swapaxes(root, -1, -2) @ e[index][..., None]))[..., 0]
        spread[index, : root.shape[-1]] = root
    return LeftOut(left, spread, growth, determined)
