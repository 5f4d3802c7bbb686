"""Products of draws with each other and with the projection: sums by variance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, IntArray


@dataclass(frozen=True, eq=False)
class Draws:
    """Draws a of B sets: their products with the inverse covariance and the projections.

    owner : ndarray of int, shape (B, a), variance of each draw; -1 where there is none
    M : ndarray, shape (B, a, a); T : ndarray, shape (B, a, c); E : ndarray, shape (B, a, f)
    y : ndarray, shape (B, a), products with the response
    """

    owner: IntArray
    M: Array
    T: Array
    E: Array
    y: Array

    def slopes(self, t: int) -> Array:
        """``z^T P z - (z^T P y)^2``, summed by variance, shape (t,)."""
        own = np.einsum("baa->ba", self.M) - (self.T**2).sum(axis=-1) - (self.E**2).sum(axis=-1)
        return np.asarray((self._of(t) * (own - self.y**2)[..., None]).sum(axis=(0, 1)))

    def near(self, t: int) -> Array:
        """What the draws of one set add to the sum of ``(T_a . T_b + E_a . E_b)^2``, shape (t, t)."""
        far = self.T @ _t(self.T) + self.E @ _t(self.E)
        of = self._of(t)
        return np.asarray((_t(of) @ (self.M * (self.M - 2.0 * far)) @ of).sum(axis=0))

    def squares(self, t: int) -> Array:
        """Sums of ``E_a E_a^T`` by variance, shape (t, f, f)."""
        own = (self.E[self.owner == j] for j in range(t))
        return np.stack([E.T @ E for E in own])

    def linked(self, j: int) -> Array:
        """Sums of ``T_a [T_a, sqrt(2) E_a]^T`` over the draws of variance j, shape (B, c, c + f)."""
        of = self.owner == j
        mine = of.any(axis=0)
        T = self.T[:, mine]
        right = np.concatenate([T, np.sqrt(2.0) * self.E[:, mine]], axis=-1)
        return np.asarray(_t(T * of[:, mine, None]) @ right)

    def _of(self, t: int) -> Array:
        return np.eye(t + 1)[self.owner][..., :t]


def _t(a: Array) -> Array:
    return np.swapaxes(a, -1, -2)
