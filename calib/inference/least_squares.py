"""Linear least squares with prior rows: triangle, rank, solution, covariance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, IntArray
from calib.errors import Unsolvable

RANK = 1e-9
"""Share of a column's length that the columns before it leave, below which it depends on them."""
_DIGITS = 1e-6  # share of a column's length: products of columns hold no less than its square


@dataclass(frozen=True, eq=False)
class LinearSolution:
    """The minimum of ``|y - X c|^2 + |o - P c|^2``.

    values : ndarray, shape (k,), of the columns; zero for those that depend on others
    covariance : ndarray, shape (k, k), for rows of unit variance; zero for the same columns
    residual : ndarray, shape (N,)
    kept : ndarray of int, positions of independent columns, ascending
    """

    values: Array
    covariance: Array
    residual: Array
    kept: IntArray

    @property
    def rank(self) -> int:
        """Number of independent columns."""
        return len(self.kept)


def solve(
    X: Array, y: Array, prior: Array | None = None, offset: Array | None = None
) -> LinearSolution:
    """Solve a linear least-squares problem.

    X : ndarray, shape (N, k); y : ndarray, shape (N,), rows of unit variance
    prior, offset : ndarray, shapes (h, k) and (h,), further rows of unit variance ``offset = prior c``

    Raises Unsolvable where a number is not finite.
    """
    k = X.shape[1]
    prior = np.zeros((0, k)) if prior is None else prior
    offset = np.zeros(len(prior)) if offset is None else offset
    R = joined_triangle([np.column_stack([X, y]), np.column_stack([prior, offset])])
    kept = independent_columns(R[:, :k])
    T = triangle(R[:, np.append(kept, k)])
    inverse = inverse_triangle(T[: len(kept), : len(kept)])
    values, covariance = np.zeros(k), np.zeros((k, k))
    values[kept] = inverse @ T[: len(kept), -1]
    covariance[np.ix_(kept, kept)] = inverse @ inverse.T
    return LinearSolution(values, covariance, y - X @ values, kept)


def independent_columns(X: Array) -> IntArray:
    """Positions of a largest set of independent columns (N, k), ascending, by pivoted QR."""
    from scipy.linalg import qr

    lengths = np.linalg.norm(X, axis=0)
    scaled = triangle(X / np.where(lengths > 0.0, lengths, 1.0))
    if not scaled.size:
        return np.zeros(0, dtype=np.int_)
    R, order = qr(scaled, mode="r", pivoting=True)
    return np.sort(order[: int(np.count_nonzero(np.abs(np.diag(R)) > RANK))]).astype(np.int_)


def triangle(A: Array) -> Array:
    """R (k, k) of ``A = Q R``, for A of shape (N, k); rows of zeros complete a short one.

    Raises Unsolvable where a number is not finite.
    """
    if not np.isfinite(A).all():
        raise Unsolvable
    R = np.asarray(np.linalg.qr(A, mode="r"))
    return np.pad(R, ((0, A.shape[1] - len(R)), (0, 0)))


def joined_triangle(parts: Sequence[Array]) -> Array:
    """Triangle (k, k) of the rows (N_i, k) of several parts.

    Products of columns give it fastest. Where they have lost the digits of what a column adds to those
    before it, the rows themselves give it.
    """
    G = np.sum([part.T @ part for part in parts], axis=0)
    if not np.isfinite(G).all():
        raise Unsolvable
    scale = np.sqrt(np.diag(G))
    scale = np.where(scale > 0.0, scale, 1.0)
    try:
        R = np.linalg.cholesky(G / np.outer(scale, scale)).T
    except np.linalg.LinAlgError:
        R = np.zeros_like(G)
    exact = (np.diag(R) > _DIGITS).all()
    return np.asarray(R * scale) if exact else triangle(np.concatenate(list(parts)))


def inverse_triangle(R: Array) -> Array:
    """Inverse of an upper triangle (k, k) of full rank."""
    from scipy.linalg import solve_triangular

    return np.asarray(solve_triangular(R, np.eye(len(R)))) if len(R) else R
