"""The information that each candidate pose brings, for all candidates at once.

Symmetric matrices are kept as vectors, so that their inner product is a dot product: off-diagonal
entries carry a factor sqrt(2), ``<A, B> = pack(A) @ pack(B)``. A million information matrices of nine
parameters are then one array of 45 columns, and pricing them is one product.
"""

from __future__ import annotations

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

        Of its principal axes the ones that tell most. They come from Cholesky factors, the largest of
        what is left first, whose entries are unpacked as they are needed.
        """
        p, n = len(self.fixed), np.arange(len(self))
        entry, scale = _places(p), np.where(np.eye(p, dtype=bool), 1.0, np.sqrt(0.5))
        left = self.packed[:, np.diag(entry)].copy()
        enough = 1e-14 * left.max(axis=1)
        factors = np.zeros((self.rank, len(self), p))
        for k in range(self.rank):
            pivot = left.argmax(axis=1)
            height = left[n, pivot]
            if (height <= enough).all():
                factors = factors[:k]
                break
            row = self.packed[n[:, None], entry[pivot]] * scale[pivot]
            row -= np.einsum("ln,lnp->np", factors[:k, n, pivot], factors[:k])
            row[height <= enough] = 0.0
            factors[k] = row / np.sqrt(np.maximum(height, enough + 1e-300))[:, None]
            left = np.maximum(left - factors[k] ** 2, 0.0)
        half = np.ascontiguousarray(factors.swapaxes(0, 1))
        axes = np.linalg.eigh(half @ half.swapaxes(1, 2))[1][..., -_AXES:]
        return np.asarray(axes.swapaxes(1, 2) @ half)

    def scores(self, G: Array) -> Array:
        """``<G, M_i>`` of every candidate, shape (n,)."""
        return np.asarray(self.packed @ pack(G))

    def plus(self, more: Array) -> Blocks:
        """The same candidates where more is known in any case, ndarray of shape (p, p)."""
        helped = replace(self, fixed=self.fixed + more)
        # Those of the candidates do not depend on what is known in any case.
        helped.__dict__["rows"] = self.rows
        return helped

    def take(self, index: IntArray) -> Blocks:
        """The blocks of some candidates."""
        return Blocks(self.packed[index], self.fixed, self.rank)


@lru_cache(maxsize=32)
def _entries(p: int) -> tuple[IntArray, IntArray, Array]:
    rows, columns = np.triu_indices(p)
    return rows, columns, np.where(rows == columns, 1.0, np.sqrt(2.0))


@lru_cache(maxsize=32)
def _places(p: int) -> IntArray:
    """Where each entry of a matrix (p, p) stands among the packed ones."""
    rows, columns, _ = _entries(p)
    places = np.zeros((p, p), dtype=int)
    places[rows, columns] = places[columns, rows] = np.arange(len(rows))
    return places


def packed_size(p: int) -> int:
    """Length of a packed matrix of p rows."""
    return p * (p + 1) // 2


def pack(M: Array) -> Array:
    """Symmetric matrices (..., p, p) -> (..., p (p + 1) / 2)."""
    rows, columns, scale = _entries(M.shape[-1])
    return np.asarray(M[..., rows, columns] * scale)


def unpack(packed: Array) -> Array:
    """The inverse of :func:`pack`: shape (..., p (p + 1) / 2) to (..., p, p)."""
    p = round((np.sqrt(8.0 * packed.shape[-1] + 1.0) - 1.0) / 2.0)
    return np.take(packed / _entries(p)[2], _places(p), axis=-1)


def lessened(cov: Array, out: Array, share: float) -> Array:
    """Covariance with a share of what a pose tells taken away: all may leave the information singular.

    cov : ndarray, shape (p, p); out : ndarray, shape (r, p), the pose's rows; share : float, < 1
    """
    U = out @ cov
    return np.asarray(cov + U.T @ np.linalg.solve(np.eye(len(out)) / share - U @ out.T, U))


def fall(cov: Array, G: Array, into: Array) -> Array:
    """By how much poses lower a trace of the covariance, ``tr((I + A C A')^-1 A G A')``, shape (n,).

    cov : ndarray, shape (p, p), C without it; G : ndarray, shape (p, p), ``C W C`` for the trace of
    ``W C``; into : ndarray, shape (n, r, p), rows A of each
    """
    S, N = _turned((cov, G), into)
    return _trace(np.eye(into.shape[1])[..., None] + S, N)


def growth(cov: Array, into: Array) -> Array:
    """By how much poses raise the log-determinant of the information, shape (n,).

    cov : ndarray, shape (p, p), without it; into : ndarray, shape (n, r, p), rows of each
    """
    (S,) = _turned((cov,), into)
    return np.asarray(np.linalg.slogdet(np.eye(len(S)) + np.moveaxis(S, 2, 0))[1])


def _turned(forms: tuple[Array, ...], into: Array) -> Array:
    """``A G A'`` of each pose by each of k matrices G, shape (k, r, r, n)."""
    n, r, p = into.shape
    own = into.reshape(n * r, p) @ np.concatenate(forms, axis=1)
    products = own.reshape(n, -1, p) @ np.swapaxes(into, 1, 2)
    return np.ascontiguousarray(products.reshape(n, r, -1, r).transpose(2, 1, 3, 0))


def _trace(S: Array, N: Array) -> Array:
    """``tr(S^-1 N)`` of many small symmetric matrices (r, r, n), unknowns put out in turn."""
    total = np.zeros(S.shape[2])
    for least in np.maximum(_ROUNDING * np.abs(np.einsum("rrn->rn", S)), 1.0):
        pivot = np.maximum(np.abs(S[0, 0]), least)  # no less but for rounding
        total += N[0, 0] / pivot
        out = S[1:, 0] / pivot
        half = N[1:, 0] - 0.5 * N[0, 0] * out
        N = N[1:, 1:] - out[:, None] * half - half[:, None] * out
        S = S[1:, 1:] - out[:, None] * S[0, 1:]
    return total
