"""Configurations as their approaches share them: their covariance, its half inverse, its derivatives.

The turned rows of a configuration with approaches a have the covariance

    V = blockdiag(s^2 I + H_a U H_a^T) + H C H^T = L^-1 (I + K K^T) L^-T

with L approach by approach and few columns K, so that ``(I + K K^T)^-1 = I - K (I + K^T K)^-1 K^T``
(Woodbury, Princeton University SRG Memorandum 42, 1950): the cost grows as the approaches do, never as
their square.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, IntArray
from calib.solver import inverse_factor

_MOVED = 1e-9  # of a lever's usual length


@dataclass(frozen=True, eq=False)
class Block:
    """B configurations with A approaches each, d turned rows an approach.

    own : ndarray, shape (B, A, d, q), levers of what is new at each approach
    shared : ndarray, shape (B, A, d, c), levers of what comes again in each
    own_of, shared_of : ndarray of int, shapes (q,) and (c,), the variance of each lever
    F : ndarray, shape (B, A, d, f), columns and, last, the readings
    """

    own: Array
    shared: Array
    own_of: IntArray
    shared_of: IntArray
    F: Array

    @property
    def rows(self) -> int:
        """How many there are."""
        return math.prod(self.F.shape[:-1])

    @property
    def moved(self) -> int:
        """How many rows some lever moves."""
        sizes = np.abs(self.own).sum(axis=-1) + np.abs(self.shared).sum(axis=-1)
        return int(np.count_nonzero(sizes > _MOVED))


@dataclass(frozen=True, eq=False)
class Half:
    """Half inverses ``(I - K S K^T) L`` of the covariances of a block.

    L : ndarray, shape (B, A, d, d); K : ndarray, shape (B, A, d, k), levers that are shared, times L
    S, root : ndarray, shape (B, k, k), ``(I - K S K^T)^2 = (I + K K^T)^-1`` and
        ``root root^T = (I + K^T K)^-1``
    log_det : float, of the inverse of the covariance
    """

    L: Array
    K: Array
    S: Array
    root: Array
    log_det: float

    @classmethod
    def of(cls, block: Block, theta: Array) -> Half:
        """At variances theta (v,)."""
        V = (block.own * theta[block.own_of]) @ _t(block.own)
        L = inverse_factor(V + theta[0] * np.eye(V.shape[-1]))
        sizes = np.sqrt(theta[block.shared_of])
        K = L @ (block.shared[..., sizes > 0.0] * sizes[sizes > 0.0])
        flat = _long(K)
        squares, axes = np.linalg.eigh(_t(flat) @ flat)
        grown = np.sqrt(1.0 + np.maximum(squares, 0.0))[:, None, :]
        S, root = (axes / (grown * (1.0 + grown))) @ _t(axes), axes / grown
        log_det = np.log(np.diagonal(L, axis1=-2, axis2=-1)).sum() - np.log(grown).sum()
        return cls(L, K, S, root, 2.0 * float(log_det))

    def together(self, rows: Array) -> Array:
        """``(I - K S K^T)`` times rows (B, A, d, p)."""
        if not self.K.shape[-1]:
            return rows
        K, own = _long(self.K), _long(rows)
        return np.asarray((own - K @ (self.S @ (_t(K) @ own))).reshape(rows.shape))

    def __call__(self, rows: Array) -> Array:
        """Independent rows of rows (B, A, d, p)."""
        return self.together(self.L @ rows)

    def pulls(self, block: Block, left: Array, count: int) -> Array:
        """``x^T V^-1 V_j V^-1 x`` by every variance j of so many, (v,), x by its independent rows.

        left : ndarray, shape (B, A, d, 1)
        """
        found, back = np.zeros(count), _t(self.L) @ self.together(left)
        found[0] = float((back**2).sum())
        shared = _t(_long(block.shared)) @ _long(back)
        np.add.at(found, block.own_of, _squares((_t(block.own) @ back)[..., 0], 1))
        np.add.at(found, block.shared_of, _squares(shared[..., 0], 1))
        return found


@dataclass(frozen=True, eq=False)
class Levers:
    """Columns of a block whose outer products are the derivatives by each variance.

    half : Half; owner : ndarray of int, shape (q + c,), whose each lever is
    each : ndarray, shape (B, A, d, q), ``L H_a`` of what is new at each approach, after what the
        instrument does
    shared : ndarray, shape (B, A, d, c), independent rows of what comes again
    """

    half: Half
    owner: IntArray
    each: Array
    shared: Array

    @classmethod
    def of(cls, block: Block, half: Half) -> Levers:
        """Of a block at the variances of its half inverse."""
        instrument = np.zeros(block.own.shape[-2], dtype=int)
        owner = np.concatenate([instrument, block.own_of, block.shared_of])
        each = np.concatenate([half.L, half.L @ block.own], axis=-1)
        return cls(half, owner, each, half(block.shared))

    @property
    def _told(self) -> Array:
        """What the other rows of a configuration take from each approach's, shape (B, A, k, q)."""
        return _t(self.half.root)[:, None] @ (_t(self.half.K) @ self.each)

    def slopes(self, columns: Array) -> Array:
        """``z^T V^-1 z - |columns^T z|^2`` of the levers z, summed, shape (q + c,).

        columns : ndarray, shape (B, A, d, p), independent rows
        """
        back, shared = self.half.together(columns), _long(self.shared)
        own = _squares(self.each, 1) - _squares(self._told, 1)
        own = own - _squares(_t(back) @ self.each, 1)
        return np.append(own, _squares(shared, 1) - _squares(_t(_long(columns)) @ shared, 1))

    def products(self) -> Array:
        """Squares of ``z_i^T V^-1 z_j`` of all levers, summed, shape (q + c, q + c).

        Of approaches a and b, ``z_a^T V^-1 z_b = [a = b] each_a^T each_a - told_a^T told_b``.
        """
        told, shared = self._told, _long(self.shared)
        taken = _t(told) @ told
        own = _squares(_t(self.each) @ self.each - taken, 2)
        if told.shape[-2]:
            outer = np.einsum("bakq,balq->bqkl", told, told, optimize=True)
            outer = outer.reshape(*outer.shape[:2], -1)
            own = own + (outer @ _t(outer)).sum(axis=0) - _squares(taken, 2)
        across = _squares(_t(self.each) @ self.half.together(self.shared), 2)
        return np.block([[own, across], [across.T, _squares(_t(shared) @ shared, 2)]])


def _squares(a: Array, left: int) -> Array:
    """Sums of squares over all but the last axes, of which so many are left."""
    over = a.ndim - left
    flat = a.reshape(math.prod(a.shape[:over]), *a.shape[over:])
    return np.asarray(np.einsum("b...,b...->...", flat, flat))


def _long(rows: Array) -> Array:
    """Rows (B, A, d, p) with the approaches of a configuration in one axis, (B, A d, p)."""
    B, A, d, p = rows.shape
    return rows.reshape(B, A * d, p)


def _t(a: Array) -> Array:
    return np.swapaxes(a, -1, -2)
