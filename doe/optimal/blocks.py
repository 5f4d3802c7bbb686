"""The information that each candidate pose brings, for all candidates at once.

Symmetric matrices are kept as vectors, so that their inner product is a dot product: off-diagonal
entries carry a factor sqrt(2), ``<A, B> = pack(A) @ pack(B)``. A million information matrices of nine
parameters are then one array of 45 columns, and pricing them is one product.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from calib.arrays import Array, IntArray

_ROUNDING = 1e-14
_AXES = 6  # rows of a candidate by which it is ranked


@dataclass(frozen=True, eq=False)
class Blocks:
    """Information matrices of n candidates, and of what is measured in any case.

    packed : ndarray, shape (n, p (p + 1) / 2), in the coordinates of the criteria
    fixed : ndarray, shape (p, p), of poses that are part of every plan; a trace of the identity keeps
        it positive definite
    rank : int, largest rank of a candidate's matrix, at most the rows of its readings
    """

    packed: Array
    fixed: Array
    rank: int

    def __len__(self) -> int:
        return len(self.packed)

    def matrices(self, index: IntArray) -> Array:
        """Information matrices of some candidates, shape (k, p, p)."""
        return unpack(self.packed[index])

    def total(self, index: IntArray, weights: Array | None = None) -> Array:
        """Information of a plan, the fixed poses included, shape (p, p)."""
        rows = self.packed[index]
        return self.fixed + unpack(rows.sum(axis=0) if weights is None else weights @ rows)

    @cached_property
    def mean(self) -> Array:
        """Mean information of a candidate, shape (p, p)."""
        return unpack(self.packed.mean(axis=0))

    @cached_property
    def rows(self) -> Array:
        """Rows J of every candidate with ``J^T J`` nearly its matrix, shape (n, r, p).

        They are the principal axes that tell most, within the range that random directions show.
        """
        turn = np.random.default_rng(0).normal(size=(len(self.fixed), self.rank))
        image = unpack(self.packed) @ turn
        inner = turn.T @ image
        trace = np.trace(inner, axis1=1, axis2=2)[:, None, None]
        L = np.linalg.cholesky(inner + (_ROUNDING * trace + 1e-300) * np.eye(self.rank))
        half = np.linalg.solve(L, np.swapaxes(image, 1, 2))
        axes = np.linalg.eigh(half @ np.swapaxes(half, 1, 2))[1][..., -_AXES:]
        return np.asarray(np.swapaxes(axes, 1, 2) @ half)

    def scores(self, G: Array) -> Array:
        """``<G, M_i>`` of every candidate, shape (n,)."""
        return np.asarray(self.packed @ pack(G))

    def plus(self, more: Array) -> Blocks:
        """The same candidates where more is known in any case, ndarray of shape (p, p)."""
        helped = replace(self, fixed=self.fixed + more)
        helped.__dict__["rows"] = self.rows  # which do not depend on it
        return helped

    def take(self, index: IntArray) -> Blocks:
        """The blocks of some candidates."""
        return replace(self, packed=self.packed[index])


@lru_cache(maxsize=32)
def _entries(p: int) -> tuple[IntArray, IntArray, Array, IntArray]:
    """Row, column and factor of each packed entry, and where each entry (p, p) is packed."""
    rows, columns = np.triu_indices(p)
    places = np.zeros((p, p), dtype=int)
    places[rows, columns] = places[columns, rows] = np.arange(len(rows))
    return rows, columns, np.where(rows == columns, 1.0, np.sqrt(2.0)), places


def packed_size(p: int) -> int:
    """Length of a packed matrix of p rows."""
    return p * (p + 1) // 2


def pack(M: Array) -> Array:
    """Symmetric matrices (..., p, p) -> (..., p (p + 1) / 2)."""
    rows, columns, scale, _ = _entries(M.shape[-1])
    return np.asarray(M[..., rows, columns] * scale)


def unpack(packed: Array) -> Array:
    """The inverse of :func:`pack`: shape (..., p (p + 1) / 2) to (..., p, p)."""
    p = round((np.sqrt(8.0 * packed.shape[-1] + 1.0) - 1.0) / 2.0)
    _, _, scale, places = _entries(p)
    return np.take(packed / scale, places, axis=-1)


def downdated(cov: Array, rows: Array, share: float) -> Array:
    """Covariance without a share of what a pose tells: without all of it M may be singular.

    cov : ndarray, shape (p, p); rows : ndarray, shape (r, p), of the pose; share : float, < 1
    """
    U = rows @ cov
    return np.asarray(cov + U.T @ np.linalg.solve(np.eye(len(rows)) / share - U @ rows.T, U))


def trace_decrease(cov: Array, G: Array, rows: Array) -> Array:
    """By how much poses lower a trace of the covariance, ``tr((I + A C A')^-1 A G A')``, shape (n,).

    cov : ndarray, shape (p, p), C without them; G : ndarray, shape (p, p), ``C W C`` for the trace of
    ``W C``; rows : ndarray, shape (n, r, p), A of each
    """
    S, N = _turned((cov, G), rows)
    total = np.zeros(S.shape[2])
    for pivot, out in _eliminated(S):
        total += N[0, 0] / pivot
        half = N[1:, 0] - 0.5 * N[0, 0] * out
        N = N[1:, 1:] - out[:, None] * half - half[:, None] * out
    return total


def logdet_increase(cov: Array, rows: Array) -> Array:
    """By how much poses raise the log-determinant of the information, shape (n,).

    cov : ndarray, shape (p, p), without them; rows : ndarray, shape (n, r, p), of each
    """
    (S,) = _turned((cov,), rows)
    return np.asarray(np.log([pivot for pivot, _ in _eliminated(S)]).sum(axis=0))


def _eliminated(S: Array) -> Iterator[tuple[Array, Array]]:
    """Pivots and multipliers of ``I + S`` of each pose, one unknown after another.

    For many small matrices, ten times as fast as LAPACK.
    """
    S = np.eye(len(S))[..., None] + S
    for least in np.maximum(_ROUNDING * np.abs(np.einsum("rrn->rn", S)), 1.0):
        pivot = np.maximum(np.abs(S[0, 0]), least)  # no less but for rounding
        out = S[1:, 0] / pivot
        yield pivot, out
        S = S[1:, 1:] - out[:, None] * S[0, 1:]


def _turned(forms: tuple[Array, ...], rows: Array) -> Array:
    """``A G A'`` of each pose by each of k matrices G, shape (k, r, r, n)."""
    n, r, p = rows.shape
    turned = rows.reshape(n * r, p) @ np.concatenate(forms, axis=1)
    products = turned.reshape(n, -1, p) @ np.swapaxes(rows, 1, 2)
    return np.ascontiguousarray(products.reshape(n, r, -1, r).transpose(2, 1, 3, 0))
