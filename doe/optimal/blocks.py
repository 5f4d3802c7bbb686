"""The information that each candidate pose brings, for all candidates at once."""

from __future__ import annotations

from dataclasses import dataclass

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

    def scores(self, G: Array) -> Array:
        """``<G, M_i>`` of every candidate, shape (n,)."""
        return np.asarray(self.packed @ pack(G))

    def take(self, index: IntArray) -> Blocks:
        """The blocks of some candidates."""
        return Blocks(self.packed[index], self.fixed, self.rank)
