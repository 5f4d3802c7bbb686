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


@dataclass(frozen=True, eq=False)
class Blocks:
    """Information matrices of n candidates, and of what is measured in any case.

    packed : ndarray, shape (n, p (p + 1) / 2), in the coordinates of the criteria
    fixed : ndarray, shape (p, p), of poses that are part of every plan; a trace of the identity keeps
        it positive definite
    """

    packed: Array
    fixed: Array

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

    def scores(self, G: Array) -> Array:
        """``<G, M_i>`` of every candidate, shape (n,)."""
        return np.asarray(self.packed @ pack(G))

    def beside(self, more: Array) -> Blocks:
        """The same candidates where more is known in any case, ndarray of shape (p, p)."""
        return replace(self, fixed=self.fixed + more)

    def take(self, index: IntArray) -> Blocks:
        """The blocks of some candidates."""
        return Blocks(self.packed[index], self.fixed)


@lru_cache(maxsize=32)
def _entries(p: int) -> tuple[IntArray, IntArray, Array]:
    rows, columns = np.triu_indices(p)
    return rows, columns, np.where(rows == columns, 1.0, np.sqrt(2.0))


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
    rows, columns, scale = _entries(p)
    M = np.empty((*packed.shape[:-1], p, p))
    M[..., rows, columns] = M[..., columns, rows] = packed / scale
    return M
