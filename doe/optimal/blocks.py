"""The information that each candidate pose brings, for all candidates at once."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib.arrays import Array, IntArray
from doe.optimal.packed import pack, unpack


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
        """Rows J of every candidate with ``J^T J`` its matrix, shape (n, r, p), r at most the rank.

        Cholesky factors, the largest of what is left first; entries are unpacked as they are needed.
        """
        p, n = len(self.fixed), np.arange(len(self))
        where = unpack(np.arange(1.0, self.packed.shape[1] + 1.0) * pack(np.ones((p, p))))
        entry = where.round().astype(int) - 1
        scale = np.where(np.eye(p, dtype=bool), 1.0, np.sqrt(0.5))
        left = self.packed[:, np.diag(entry)].copy()
        enough = 1e-14 * left.max(axis=1)
        found = np.zeros((self.rank, len(self), p))
        for k in range(self.rank):
            pivot = left.argmax(axis=1)
            height = left[n, pivot]
            if (height <= enough).all():
                return np.ascontiguousarray(found[:k].swapaxes(0, 1))
            row = self.packed[n[:, None], entry[pivot]] * scale[pivot]
            row -= np.einsum("ln,lnp->np", found[:k, n, pivot], found[:k])
            row[height <= enough] = 0.0
            found[k] = row / np.sqrt(np.maximum(height, enough + 1e-300))[:, None]
            left = np.maximum(left - found[k] ** 2, 0.0)
        return np.ascontiguousarray(found.swapaxes(0, 1))

    def scores(self, G: Array) -> Array:
        """``<G, M_i>`` of every candidate, shape (n,)."""
        return np.asarray(self.packed @ pack(G))

    def beside(self, more: Array) -> Blocks:
        """The same candidates where more is known in any case, ndarray of shape (p, p)."""
        found = replace(self, fixed=self.fixed + more)
        found.__dict__["rows"] = self.rows
        return found

    def take(self, index: IntArray) -> Blocks:
        """The blocks of some candidates."""
        return Blocks(self.packed[index], self.fixed, self.rank)
