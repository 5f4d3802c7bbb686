"""Decorrelation of whole poses that err together: rows of readings made independent.

The whitened rows of one configuration have the covariance

    V = s^2 I + H C H^T + blockdiag(H_a U H_a^T)

with the levers H of its readings, H_a those of one approach. Its inverse Cholesky factor turns the
rows into innovations: each row less what the rows before it tell of it, in the same approach and then
in the same configuration. Poses that do not count have rows of zeros and stay so.

Rows y of a group with covariance ``I + K K^T`` err by ``K c`` beside their own noise, c of unit
variance. What the readings before tell of c has the mean ``M^-1 t`` and the covariance ``M^-1``, with

    M = I + sum K_i^T K_i,    t = sum K_i^T y_i    (i before j)

(Kalman, J. Basic Eng. 82(1), 1960), and reading j leaves the innovation ``T_j (y_j - K_j M^-1 t)`` with
T_j the inverse Cholesky factor of ``I + K_j M^-1 K_j^T``. All together are the inverse Cholesky factor
of the whole group, at a cost that grows as the readings do. A reading of many rows has the symmetric
root in its place, which the levers make: rows of the group are then independent all the same.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib.arrays import Array, IntArray, by_size, in_parts, stacked
from calib.solver import inverse_factor

_DENSE = 4  # rows of a reading for each lever, up to which its factor is a triangle


@dataclass(frozen=True, eq=False)
class InverseFactor:
    """T with ``T (I + L L^T) T^T = I`` of the R rows of each reading: a triangle, or symmetric.

    ``T = I - L S L^T`` where rows are many times the levers: of an image of many corners the R columns
    of T would be the largest array of all.

    T : ndarray, shape (..., R, R), where rows are few, else S, shape (..., k, k)
    L : ndarray, shape (..., R, k), or None where T is given
    """

    T: Array
    L: Array | None = None

    @classmethod
    def of(cls, K: Array, told: Array, M: Array | None) -> InverseFactor:
        """Of levers K (..., R, k) of what has the covariance ``M^-1``; told : ``K M^-1``."""
        rows, k = K.shape[-2:]
        if rows <= _DENSE * k:
            return cls(inverse_factor(np.eye(rows) + told @ _t(K)))
        L = K if M is None else K @ _t(inverse_factor(M))
        squares, axes = np.linalg.eigh(_t(L) @ L)
        grown = np.sqrt(1.0 + np.maximum(squares, 0.0))[..., None, :]
        return cls((axes / (grown * (1.0 + grown))) @ _t(axes), L)

    def __call__(self, rows: Array) -> Array:
        """T times rows (..., R, p)."""
        if self.L is None:
            return np.asarray(self.T @ rows)
        return np.asarray(rows - self.L @ (self.T @ (_t(self.L) @ rows)))

    def back(self, rows: Array) -> Array:
        """Its transpose times rows (..., R, p)."""
        return np.asarray(_t(self.T) @ rows) if self.L is None else self(rows)


@dataclass(frozen=True, eq=False)
class ReadingBlock:
    """B groups with r readings.

    index : ndarray of int, shape (B, r), the readings
    K, told : ndarray, shape (..., B, r, R, k), levers, and how c as told by the readings before enters
    factor : InverseFactor, of what each reading leaves
    """

    index: IntArray
    K: Array
    told: Array
    factor: InverseFactor

    def part(self, own: slice) -> ReadingBlock:
        """Some of its groups."""
        factor = self.factor
        L = None if factor.L is None else factor.L[..., own, :, :, :]
        part = InverseFactor(factor.T[..., own, :, :, :], L)
        at = (..., own, slice(None), slice(None), slice(None))
        return ReadingBlock(self.index[own], self.K[at], self.told[at], part)


@dataclass(frozen=True, eq=False)
class Level:
    """What the readings of a group share, approaches or configurations: its inverse Cholesky factor.

    group : ndarray of int, shape (m,); K : ndarray, shape (..., m, R, k), levers of one unit each
    blocks : tuple of ReadingBlock, of rows that the levels before have made independent
    """

    group: IntArray
    K: Array
    blocks: tuple[ReadingBlock, ...]

    @classmethod
    def of(cls, group: IntArray, K: Array, own: Array) -> Level:
        """Of levers K, and the same in rows that the levels before have made independent."""
        blocks = tuple(_block(index, own[..., index, :, :]) for index in by_size(group))
        return cls(group, K, blocks)

    def __call__(self, rows: Array) -> Array:
        """Independent rows of unit variance, both (..., m, R, p)."""
        out = np.empty(rows.shape)
        for whole in self.blocks:
            each = whole.index.shape[1] * math.prod((*rows.shape[:-3], *rows.shape[-2:]))
            for block in map(whole.part, in_parts(len(whole.index), each)):
                own = rows[..., block.index, :, :]
                if block.index.shape[1] > 1:
                    own = own - block.told @ _before(_t(block.K) @ own)
                out[..., block.index, :, :] = block.factor(own)
        return out

    def back(self, gains: Array) -> Array:
        """Gains on the rows, from those on the independent ones, both (..., m, R, p)."""
        out = np.empty(gains.shape)
        for block in self.blocks:
            own = block.factor.back(gains[..., block.index, :, :])
            if block.index.shape[1] > 1:
                after = _t(block.told) @ own
                own = own - block.K @ _before(after[..., ::-1, :, :])[..., ::-1, :, :]
            out[..., block.index, :, :] = own
        return out


@dataclass(frozen=True, eq=False)
class Mixing:
    """Decorrelation of the rows of poses that err as a whole.

    levels : tuple of Level, approaches first, of rows in the instrument's actual standard deviations
    scale : float, actual over stated standard deviation of the instrument
    """

    levels: tuple[Level, ...]
    scale: float

    def __call__(self, rows: Array) -> Array:
        """Independent rows of unit variance, from whitened ones, both (..., m, R, p)."""
        first, *others = self.levels or (None,)
        if first is None:
            return rows / self.scale
        rows = first(rows)  # a copy
        rows /= self.scale
        for level in others:
            rows = level(rows)
        return rows

    def back(self, gains: Array) -> Array:
        """Gains on whitened rows, from those on the independent rows made of them, (..., m, R, p)."""
        for level in reversed(self.levels):
            gains = level.back(gains)
        return gains / self.scale

    def covariance(self, gains: Array) -> Array:
        """Covariance (p, p) of what follows whitened rows by ``gains`` (m, R, p)."""
        parts = [stacked(gains)]
        for level in self.levels:
            each = _t(level.K) @ gains
            parts += [stacked(each[index].sum(axis=1)) for index in by_size(level.group)]
        return self.scale**2 * np.asarray(sum(flat.T @ flat for flat in parts))

    @cached_property
    def taken(self) -> tuple[tuple[IntArray, Array], ...]:
        """What is shared in the inverse covariance, ``(I - sum over groups of G G^T) / scale^2``.

        Groups (B, r) and their G (B, r, R, k), of levers without leading axes.
        """
        found = []
        for i, level in enumerate(self.levels):
            before = Mixing(self.levels[:i], 1.0)
            W = before.back(before(level.K))
            for index in by_size(level.group):
                own = W[index]
                M = np.eye(own.shape[-1]) + (_t(level.K[index]) @ own).sum(axis=1)
                found.append((index, own @ _t(inverse_factor(M))[:, None]))
        return tuple(found)


def _block(index: IntArray, K: Array) -> ReadingBlock:
    if index.shape[1] == 1:
        return ReadingBlock(index, K, K, InverseFactor.of(K, K, None))
    M = np.eye(K.shape[-1]) + _before(_t(K) @ K)
    told = _t(np.asarray(np.linalg.solve(M, _t(K))))
    return ReadingBlock(index, K, told, InverseFactor.of(K, told, M))


def _before(each: Array) -> Array:
    """Sums over the readings before, of (..., r, k, p)."""
    out = np.zeros(each.shape)
    np.cumsum(each[..., :-1, :, :], axis=-3, out=out[..., 1:, :, :])
    return out


def _t(a: Array) -> Array:
    return np.swapaxes(a, -1, -2)
