"""Symmetric matrices as vectors, so that their inner product is a dot product.

Off-diagonal entries carry a factor sqrt(2): ``<A, B> = pack(A) @ pack(B)``. A million information
matrices of nine parameters are then one array of 45 columns, and pricing them is one product.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from calib.arrays import Array, IntArray


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
