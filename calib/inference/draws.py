"""Draws of random effects: their products with the projection, summed by variance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, IntArray


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
        of = np.eye(t + 1)[self.owner][..., :t] * self.E[..., -1:]
        return np.asarray(columns @ of[self.of_cell])
