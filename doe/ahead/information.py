"""What readings tell of causes beside all that is modelled, and what further readings add.

Of independent rows of unit variance, N of what is modelled and X of what is asked about, one triangle
answers every question:

    [N X] = Q R,    R = [R_11 R_12; 0 R_22].

``P = (R_11^T R_11)^-1`` is the covariance of what is modelled, ``R_11^-1 R_12`` its imitation of X, and
``S = R_22^T R_22`` the Schur complement, what X shows beyond that. Rows (A, Y) that come later add the
block form of recursive least squares,

    S' = S + D^T (I + A P A^T)^-1 D,    D = Y - A R_11^-1 R_12.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib.arrays import Array
from calib.solver import triangle

FREE = 10.0
"""Plausible sizes to which what is modelled is known beforehand: what is open is finite."""


@dataclass(frozen=True, eq=False)
class Information:
    """The triangle of all rows so far, and of a weak prior on what is modelled.

    root : ndarray, shape (n + K, n + K), R; n : int, columns of what is modelled, which come first
    rows : int, that count
    """

    root: Array
    n: int
    rows: int

    @classmethod
    def of(cls, rows: Array, n: int) -> Information:
        """From rows (N, n + K), in plausible sizes."""
        weak = np.diag(np.arange(rows.shape[1]) < n) / FREE
        return cls(weak, n, 0).added(rows)

    @cached_property
    def inverse(self) -> Array:
        """``R_11^-1``, shape (n, n)."""
        from scipy.linalg import solve_triangular

        return np.asarray(solve_triangular(self.root[: self.n, : self.n], np.eye(self.n)))

    @property
    def S(self) -> Array:
        """Products of what is left of X, shape (K, K)."""
        rest = self.root[self.n :, self.n :]
        return np.asarray(rest.T @ rest)

    @property
    def lengths(self) -> Array:
        """Of the columns of X before the projection, shape (K,)."""
        return np.asarray(np.linalg.norm(self.root[:, self.n :], axis=0))

    def left(self, rows: Array) -> tuple[Array, Array]:
        """``A R_11^-1`` and D of further rows (..., r, n + K)."""
        along = rows[..., : self.n] @ self.inverse
        return along, np.asarray(rows[..., self.n :] - along @ self.root[: self.n, self.n :])

    def tried(self, rows: Array) -> Array:
        """S with one of m further blocks (m, r, n + K) each, shape (m, K, K)."""
        along, D = self.left(rows)
        V = along @ np.swapaxes(along, -1, -2) + np.eye(along.shape[-2])
        return np.asarray(self.S + np.swapaxes(D, -1, -2) @ np.linalg.solve(V, D))

    def added(self, rows: Array) -> Information:
        """With further rows (..., n + K), all of them."""
        flat = rows.reshape(-1, rows.shape[-1])
        count = self.rows + int(np.count_nonzero(flat.any(axis=1)))
        return Information(triangle(np.concatenate([self.root, flat])), self.n, count)
