"""Rows that share a displacement made independent, one reading after the other.

Rows y of a group with covariance ``I + K K^T`` err by ``K c`` beside their own noise, c of unit
variance. What the readings before tell of c has the mean ``M^-1 t`` and the covariance ``M^-1``, with

    M = I + sum K_i^T K_i,    t = sum K_i^T y_i    (i before j)

(Kalman, J. Basic Eng. 82(1), 1960), and reading j leaves the innovation ``T_j (y_j - K_j M^-1 t)`` with
T_j the inverse Cholesky factor of ``I + K_j M^-1 K_j^T``. All together are the inverse Cholesky factor
of the whole group, at a cost that grows as the readings do.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, IntArray, by_size
from calib.solver import inverse_factor


@dataclass(frozen=True, eq=False)
class ReadingBlock:
    """B groups with r readings.

    index : ndarray of int, shape (B, r), the readings
    K, told : ndarray, shape (..., B, r, R, k), levers, and how c as told by the readings before enters
    T : ndarray, shape (..., B, r, R, R), inverse factors of what each reading leaves
    """

    index: IntArray
    K: Array
    told: Array
    T: Array


@dataclass(frozen=True, eq=False)
class Innovations:
    """The inverse Cholesky factor of groups that each share a displacement."""

    blocks: tuple[ReadingBlock, ...]

    def __call__(self, rows: Array) -> Array:
        """Independent rows of unit variance, both (..., m, R, p)."""
        out = np.empty(rows.shape)
        for block in self.blocks:
            own = rows[..., block.index, :, :]
            if block.index.shape[1] > 1:
                own = own - block.told @ _before(_t(block.K) @ own)
            out[..., block.index, :, :] = block.T @ own
        return out

    def back(self, gains: Array) -> Array:
        """Gains on the rows, from those on the independent ones, both (..., m, R, p)."""
        out = np.empty(gains.shape)
        for block in self.blocks:
            own = _t(block.T) @ gains[..., block.index, :, :]
            if block.index.shape[1] > 1:
                after = _t(block.told) @ own
                own = own - block.K @ _before(after[..., ::-1, :, :])[..., ::-1, :, :]
            out[..., block.index, :, :] = own
        return out


def innovations(K: Array, group: IntArray) -> Innovations:
    """Of levers K (..., m, R, k) of one unit each, and the group of each reading, (m,)."""
    return Innovations(tuple(_block(index, K[..., index, :, :]) for index in by_size(group)))


def _block(index: IntArray, K: Array) -> ReadingBlock:
    R, k = K.shape[-2:]
    told = K
    if index.shape[1] > 1:
        M = np.eye(k) + _before(_t(K) @ K)
        told = _t(np.asarray(np.linalg.solve(M, _t(K))))
    return ReadingBlock(index, K, told, inverse_factor(np.eye(R) + told @ _t(K)))


def _before(each: Array) -> Array:
    """Sums over the readings before, of (..., r, k, p)."""
    out = np.zeros(each.shape)
    np.cumsum(each[..., :-1, :, :], axis=-3, out=out[..., 1:, :, :])
    return out


def _t(a: Array) -> Array:
    return np.swapaxes(a, -1, -2)
