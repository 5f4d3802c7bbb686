"""Draws of random effects: their products with the projection, summed by variance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, IntArray, stacked


@dataclass(frozen=True, eq=False)
class Draws:
    """Draws a of B sets, cells or components, each of unit variance.

    owner : ndarray of int, shape (B, a), variance of each draw; -1 where there is none
    length : ndarray, shape (B, a), ``z^T V^-1 z``; E : ndarray, shape (B, a, f + 1), products of
        ``V^-1 z`` with the orthonormal columns and, last, the residual
    of_cell : ndarray of int, shape (A,), set of each cell
    """

    owner: IntArray
    length: Array
    E: Array
    of_cell: IntArray

    def slopes(self, t: int) -> Array:
        """``z^T P z - (z^T P y)^2``, summed by variance, shape (t,)."""
        own = self.length - (self.E**2).sum(axis=-1)
        return np.asarray(np.bincount(self.owner.ravel() + 1, own.ravel(), t + 1)[1:], dtype=float)

    def moved(self, columns: Array, t: int) -> Array:
        """``sum z (z^T P y)`` by variance, turned rows (A, k, t), of columns (A, k, a)."""
        moved = columns * self.E[self.of_cell, None, :, -1]
        owner, (A, k, _) = self.owner[self.of_cell], columns.shape
        if (owner == owner[:1]).all():
            return np.asarray((stacked(moved) @ np.eye(t + 1)[owner[0], :t]).reshape(A, k, t))
        return np.asarray(moved @ np.eye(t + 1)[owner][..., :t])
