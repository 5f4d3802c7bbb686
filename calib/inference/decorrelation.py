"""Turned rows made independent of each other, cell by cell and then component by component.

The turned rows of a component have the covariance

    V = blockdiag(D_a + O_a O_a^T) + H H^T = L^-1 (I + K K^T) L^-T

with noise D, columns O of own draws and H of shared ones, L cell by cell and ``K = L H`` of few
columns, so that ``(I + K K^T)^-1 = I - K (I + K^T K)^-1 K^T`` (Woodbury, Princeton University SRG
Memorandum 42, 1950). The cost grows as the number of cells.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib.arrays import Array
from calib.inference.turned import TurnedRows
from calib.solver import inverse_factor


@dataclass(frozen=True, eq=False)
class Decorrelation:
    """Turned rows made independent: ``(I - K S K^T) L`` is an inverse root of their covariance.

    theta : ndarray, shape (i + v,), variances of instruments and effects
    """

    turned: TurnedRows
    theta: Array

    @cached_property
    def slot_variance(self) -> Array:
        """Instrument variance of each slot, shape (A, k); one where it is empty."""
        instrument = self.turned.instrument
        return np.where(instrument >= 0, self.theta[instrument], 1.0)

    @cached_property
    def _effects(self) -> Array:
        """Variances of effects and, last, of empty draws, shape (v + 1,)."""
        count = len(self.turned.outside)
        return np.append(self.theta[count:], 0.0)

    @cached_property
    def own(self) -> Array:
        """Columns of own draws of unit variance, shape (A, k, q)."""
        return np.asarray(self.turned.own * np.sqrt(self._effects[self.turned.own_of]))

    @cached_property
    def shared(self) -> Array:
        """Columns of shared draws of unit variance, shape (A, k, c)."""
        size = np.sqrt(self._effects[self.turned.shared_of])
        return np.asarray(self.turned.shared * size[self.turned.component][:, None])

    @cached_property
    def L(self) -> Array:
        """Inverse Cholesky factors of cells without what they share, shape (A, k, k)."""
        V = self.own @ _t(self.own) + self.slot_variance[..., None] * np.eye(self.own.shape[1])
        return inverse_factor(V)

    @cached_property
    def K(self) -> Array:
        """Shared columns in units of what their cells leave, shape (A, k, c)."""
        return np.asarray(self.L @ self.shared)

    @cached_property
    def _roots(self) -> tuple[Array, Array, Array]:
        """S and root (C, c, c) with ``root root^T = (I + K^T K)^-1``, and roots of ``I + K^T K``."""
        squares, axes = np.linalg.eigh(self.turned.sums(_t(self.K) @ self.K))
        grown = np.sqrt(1.0 + np.maximum(squares, 0.0))
        S = (axes / (grown * (1.0 + grown))[:, None]) @ _t(axes)
        return S, axes / grown[:, None], grown

    @property
    def root(self) -> Array:
        """Root (C, c, c) of the inverse of ``I + K^T K``."""
        return self._roots[1]

    @cached_property
    def inverse(self) -> Array:
        """Blocks (A, k, k) of the inverse covariance of the turned rows, cell by cell."""
        back = _t(self.L)
        shared = back @ self.K @ self.root[self.turned.component]
        return np.asarray(back @ self.L - shared @ _t(shared))

    def _without_shared(self, rows: Array) -> Array:
        if not self.K.shape[-1]:
            return rows
        along = self._roots[0] @ self.turned.sums(_t(self.K) @ rows)
        return np.asarray(rows - self.K @ along[self.turned.component])

    def __call__(self, inside: Array) -> Array:
        """Independent rows (A, k, w) of turned rows."""
        return self._without_shared(self.L @ inside)

    def back(self, independent: Array) -> Array:
        """The transposed map: after :meth:`__call__`, the product with the inverse covariance."""
        return np.asarray(_t(self.L) @ self._without_shared(independent))

    @cached_property
    def log_det(self) -> float:
        """Log determinant of the covariance of the turned rows."""
        own = np.log(np.diagonal(self.L, axis1=-2, axis2=-1)).sum()
        return 2.0 * float(np.log(self._roots[2]).sum() - own)


def _t(a: Array) -> Array:
    return np.swapaxes(a, -1, -2)
