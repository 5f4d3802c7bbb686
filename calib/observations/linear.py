"""A least-squares problem to first order: rows of readings, what is known beside them, what follows."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from calib.arrays import Array, stacked
from calib.inference.decorrelation import InverseRoot
from calib.model.covariance import covariance, root

DEPENDENT = 1e-8
"""Share of a column that the others leave, below which it is one of them."""


@dataclass(frozen=True, eq=False)
class LinearProblem:
    """Residuals and derivatives of m readings about some values, and the directions that are fitted.

    r : ndarray, shape (m, R), J : ndarray, shape (m, R, p), in the instrument's standard deviations
    span : ndarray, shape (p, k), directions that are estimated
    off, held : ndarray, shapes (h,) and (h, p), rows of unit variance known beside the readings
    mixing : what makes the rows independent where whole poses err together, None where they are
    weighing : the same, as far as the fit weighed the rows by it
    prior_weight : float, so many times more the rows beside the readings weighed in the fit, as the
        readings err so many times more than is stated
    """

    r: Array
    J: Array
    span: Array
    off: Array = field(default_factory=lambda: np.zeros(0))
    held: Array = field(default_factory=lambda: np.zeros((0, 0)))
    mixing: InverseRoot | None = None
    weighing: InverseRoot | None = None
    prior_weight: float = 1.0

    @classmethod
    def of_rows(cls, J: Array, mixing: InverseRoot | None = None) -> LinearProblem:
        """Derivatives (m, R, p) of readings to come, by all that may be fitted: no residual yet."""
        return cls(np.zeros(J.shape[:2]), J, np.eye(J.shape[-1]), mixing=mixing)

    def rows(self) -> Array:
        """Independent derivatives (m, R, p): only those of a whole group say what its readings do."""
        return self.J if self.mixing is None else self.mixing(self.J)

    @cached_property
    def fitted(self) -> tuple[Array, Array]:
        """Residuals (N,) and derivatives (N, p) as the fit weighed them, what is held last."""
        return self._flat(self.weighing, self.prior_weight)

    @cached_property
    def independent(self) -> tuple[Array, Array]:
        """The same of unit variance and independent of each other, as far as is known."""
        return self.fitted if self.mixing is None else self._flat(self.mixing, 1.0)

    def _flat(self, root: InverseRoot | None, prior_weight: float) -> tuple[Array, Array]:
        r, J = self.r, self.J
        if root is not None:
            r, J = root(r[..., None])[..., 0], root(J)
        if not len(self.off):
            return r.ravel(), stacked(J)
        held = prior_weight * self.held
        return np.append(r, prior_weight * self.off), np.concatenate([stacked(J), held])

    def columns(self, rows: Array) -> Array:
        """Further whitened columns (m, R, K) as independent rows (N, K), zero in what is held."""
        return _independent(rows, self.mixing, len(self.independent[0]))

    @cached_property
    def basis(self) -> Array:
        """Orthonormal basis of the fitted directions, of independent rows, shape (N, k)."""
        return orthonormal(self.independent[1] @ self.span)

    @cached_property
    def complement(self) -> Complement:
        """What the fitted directions do not follow."""
        return self.beside(self.basis, self.independent[0])

    def beside(self, Q: Array, r: Array) -> Complement:
        """The complement of columns with a basis Q (N, k), of a residual (N,)."""
        return Complement(Q, r - Q @ (Q.T @ r), self.r.shape, self.mixing)

    @cached_property
    def gains(self) -> Array:
        """How the least-squares values follow whitened rows, shape (m, R, p)."""
        return np.asarray(self._by_root @ self._root.T)

    @cached_property
    def held_gains(self) -> Array:
        """How they follow what is held, shape (h, p)."""
        return np.asarray(self.prior_weight**2 * self.held @ self._root @ self._root.T)

    def followed(self, rows: Array) -> Array:
        """How they follow whitened rows displaced by (m, R, b), shape (p, b)."""
        return np.asarray(self._root @ (stacked(self._by_root).T @ stacked(rows)))

    @cached_property
    def covariance(self) -> Array:
        """Covariance (p, p) of the least-squares values, the noise as stated."""
        if self.mixing is None:
            return covariance(self.fitted[1], self.span)
        own, held = self.mixing.covariance(self._by_root), self.held_gains
        return np.asarray(self._root @ own @ self._root.T + held.T @ held)

    @cached_property
    def _root(self) -> Array:
        """Root (p, k) of the covariance of the values, were the rows as independent as they weighed."""
        return root(self.fitted[1], self.span)

    @property
    def _by_root(self) -> Array:
        """How its k coordinates follow whitened rows, shape (m, R, k)."""
        own = (self.fitted[1][: self.r.size] @ self._root).reshape((*self.r.shape, -1))
        return own if self.weighing is None else self.weighing.back(own)


@dataclass(frozen=True, eq=False)
class Complement:
    """The orthogonal complement of fitted columns, in independent rows: what least squares leaves.

    Q : ndarray, shape (N, k), ``Q Q^T`` projects onto the columns: an orthonormal basis of them
    left : ndarray, shape (N,), residual outside of them
    readings : (m, R), of the whitened rows; mixing : what makes them independent, None where they are
    """

    Q: Array
    left: Array
    readings: tuple[int, ...]
    mixing: InverseRoot | None

    def of(self, rows: Array) -> Array:
        """Independent rows (N, ..) with the columns projected out."""
        return np.asarray(rows - self.Q @ (self.Q.T @ rows))

    def columns(self, rows: Array) -> Array:
        """The same of whitened columns (m, R, K) of the readings, shape (N, K)."""
        return self.of(_independent(rows, self.mixing, len(self.left)))

    @property
    def rows(self) -> int:
        """How many rows the fitted columns move."""
        return int(np.count_nonzero(self.Q.any(axis=1)))

    def without(self, X: Array) -> Complement:
        """The complement of further columns (N, K) as well, which lie in this one."""
        Q = orthonormal(X)
        left = self.left - Q @ (Q.T @ self.left)
        return replace(self, Q=np.concatenate([self.Q, Q], axis=1), left=left)

    @cached_property
    def at_readings(self) -> tuple[Array, Array]:
        """Residual (m, R) and basis (m, R, k), brought back to the whitened rows of the readings."""
        m, R = self.readings
        rows = np.column_stack([self.left, self.Q])[: m * R].reshape(m, R, -1)
        rows = rows if self.mixing is None else self.mixing.back(rows)
        return rows[..., 0], rows[..., 1:]


def _independent(rows: Array, mixing: InverseRoot | None, count: int) -> Array:
    """Whitened columns (m, R, K) as independent rows (count, K), zero in what is held."""
    flat = stacked(rows if mixing is None else mixing(rows))
    return np.pad(flat, ((0, count - len(flat)), (0, 0)))


def orthonormal(columns: Array) -> Array:
    """Orthonormal basis of columns (N, p), shape (N, rank)."""
    from scipy.linalg import qr

    Q, R, _ = qr(unit(columns), mode="economic", pivoting=True)
    pivots = np.abs(np.diag(R))
    return np.asarray(Q[:, pivots > DEPENDENT * pivots.max(initial=0.0)])


def unit(columns: Array) -> Array:
    """Columns (N, p) of length one; those of zeros as they are."""
    lengths = np.linalg.norm(columns, axis=0)
    return np.asarray(columns / np.where(lengths > 0.0, lengths, 1.0))
