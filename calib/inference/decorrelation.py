"""Rows made independent of each other: inverse roots of covariances with few shared errors.

Rows of poses or of cells err by their own noise, and by errors that they share with others of a group:

    V = s^2 (I + sum over levels of K K^T, each within its groups)

with K the levers of errors of unit variance. Levels go one after the other. Of rows that the levels
before have made independent, ``I + K K^T`` is left. Its inverse root is, of few rows alone, an inverse
Cholesky factor, and of the many rows of a group symmetric, of the size of the levers:

    I - K A diag(1 / (g (1 + g))) A^T K^T,    K^T K = A diag(g^2 - 1) A^T

(Woodbury, Princeton University SRG Memorandum 42, 1950). The cost grows as the number of rows does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from calib.arrays import Array, IntArray, stacked
from calib.solver import inverse_factor

if TYPE_CHECKING:
    from calib.inference.turned import TurnedRows

_DENSE = 4  # rows for each lever, up to which a triangle is the cheaper root


@dataclass(frozen=True, eq=False)
class Groups:
    """Which of m poses or cells belong together; number : ndarray of int, shape (m,), from zero."""

    number: IntArray

    @classmethod
    def of(cls, labels: IntArray) -> Groups:
        """Of labels (m,), any numbers."""
        return cls(np.unique(labels, return_inverse=True)[1].reshape(-1))

    @cached_property
    def _sorted(self) -> tuple[IntArray, IntArray]:
        order = np.argsort(self.number, kind="stable")
        return order, np.flatnonzero(np.diff(self.number[order], prepend=-1))

    @cached_property
    def alone(self) -> bool:
        """Whether every group has one member."""
        return len(self._sorted[1]) == len(self.number)

    def sums(self, each: Array) -> Array:
        """Sums over the members of each group, (..., G, a, b), of (..., m, a, b)."""
        order, starts = self._sorted
        members = each[..., order, :, :]
        return members if self.alone else np.asarray(np.add.reduceat(members, starts, axis=-3))

    def spread(self, groups: Array) -> Array:
        """What belongs to the group of each member, (..., m, a, b), of (..., G, a, b)."""
        return np.asarray(groups[..., self.number, :, :])


@dataclass(frozen=True, eq=False)
class Triangles:
    """Inverse Cholesky factors T, shape (..., m, R, R), of the rows of each pose alone."""

    T: Array

    def __call__(self, rows: Array) -> Array:
        return np.asarray(self.T @ rows)

    def back(self, rows: Array) -> Array:
        """The transposed map."""
        return np.asarray(_t(self.T) @ rows)


@dataclass(frozen=True, eq=False)
class SharedErrors:
    """Symmetric inverse root of ``I + K K^T`` within groups, K : ndarray, shape (..., m, R, k)."""

    K: Array
    groups: Groups

    @cached_property
    def _axes(self) -> tuple[Array, Array]:
        """A and g of the module's docstring, shapes (..., G, k, k) and (..., G, k)."""
        squares, axes = np.linalg.eigh(self.groups.sums(_t(self.K) @ self.K))
        return axes, np.sqrt(1.0 + np.maximum(squares, 0.0))

    @cached_property
    def root(self) -> Array:
        """Root (..., G, k, k) of the inverse of ``I + K^T K``."""
        axes, g = self._axes
        return np.asarray(axes / g[..., None, :])

    @cached_property
    def _S(self) -> Array:
        axes, g = self._axes
        return np.asarray((axes / (g * (1.0 + g))[..., None, :]) @ _t(axes))

    def __call__(self, rows: Array) -> Array:
        if not self.K.shape[-1]:
            return rows
        along = self._S @ self.groups.sums(_t(self.K) @ rows)
        return np.asarray(rows - self.K @ self.groups.spread(along))

    back = __call__

    @property
    def log_det(self) -> float:
        """Log determinant of ``I + K K^T``."""
        return 2.0 * float(np.log(self._axes[1]).sum())


Level: TypeAlias = tuple[Groups, Array]
"""Groups of poses, and levers (..., m, R, k) of what each shares."""


@dataclass(frozen=True, eq=False)
class InverseRoot:
    """W with ``W V W^T = I`` of the rows (..., m, R) of m poses.

    scale : float, s; levels : tuple of Level, in units of s; parts : their roots, in the same order
    """

    scale: float
    levels: tuple[Level, ...]
    parts: tuple[Triangles | SharedErrors, ...]

    @classmethod
    def of(cls, scale: float, levels: Sequence[Level]) -> InverseRoot:
        """Of noise s and levers of unit variance in units of s."""
        root = cls(1.0, (), ())
        for groups, K in levels:
            part = _root(groups, root(K))
            root = cls(1.0, (*root.levels, (groups, K)), (*root.parts, part))
        return cls(scale, root.levels, root.parts)

    def __call__(self, rows: Array) -> Array:
        """Independent rows of unit variance, both (..., m, R, p); those of a group go together."""
        rows = rows / self.scale
        for part in self.parts:
            rows = part(rows)
        return rows

    def back(self, rows: Array) -> Array:
        """The transposed map."""
        for part in reversed(self.parts):
            rows = part.back(rows)
        return rows / self.scale

    def covariance(self, gains: Array) -> Array:
        """Covariance (p, p) of what follows the rows by ``gains`` (m, R, p)."""
        shared = [groups.sums(_t(K) @ gains) for groups, K in self.levels]
        return np.asarray(self.scale**2 * sum(_square(stacked(a)) for a in (gains, *shared)))

    @cached_property
    def shared(self) -> tuple[Level, ...]:
        """Levels G of the inverse, ``(I - sum over levels of G G^T) / s^2``, without leading axes."""
        found = []
        for i, (groups, K) in enumerate(self.levels):
            before = InverseRoot(1.0, (), self.parts[:i])
            W = before.back(before(K))
            M = np.eye(K.shape[-1]) + groups.sums(_t(K) @ W)
            found.append((groups, W @ groups.spread(_t(inverse_factor(M)))))
        return tuple(found)


def _root(groups: Groups, K: Array) -> Triangles | SharedErrors:
    rows, k = K.shape[-2:]
    if groups.alone and rows <= _DENSE * k:
        return Triangles(inverse_factor(np.eye(rows) + K @ _t(K)))
    return SharedErrors(K, groups)


@dataclass(frozen=True, eq=False)
class Decorrelation:
    """Turned rows made independent, cell by cell and then component by component.

    theta : ndarray, shape (i + v,), variances of instruments and effects
    """

    turned: TurnedRows
    theta: Array

    @cached_property
    def _effects(self) -> Array:
        """Variances of effects and, last, of empty draws, shape (v + 1,)."""
        return np.append(self.theta[len(self.turned.outside) :], 0.0)

    @cached_property
    def own(self) -> Array:
        """Columns of own draws of unit variance, shape (A, k, q)."""
        return np.asarray(self.turned.own * np.sqrt(self._effects[self.turned.own_of]))

    @cached_property
    def shared(self) -> Array:
        """Columns of shared draws of unit variance, shape (A, k, c)."""
        size = np.sqrt(self._effects[self.turned.shared_of])
        return np.asarray(self.turned.shared * size[self.turned.components.number][:, None])

    @cached_property
    def cells(self) -> Triangles:
        """Of each cell without what it shares, shape (A, k, k)."""
        slots = self.turned.instrument
        noise = np.where(slots >= 0, self.theta[slots], 1.0)
        V = self.own @ _t(self.own) + noise[..., None] * np.eye(slots.shape[1])
        return Triangles(inverse_factor(V))

    @cached_property
    def components(self) -> SharedErrors:
        """Of what cells share, in units of what each leaves."""
        return SharedErrors(self.cells(self.shared), self.turned.components)

    @cached_property
    def inverse(self) -> Array:
        """Blocks (A, k, k) of the inverse covariance of the turned rows, cell by cell."""
        components = self.components
        shared = self.cells.back(components.K @ components.groups.spread(components.root))
        return np.asarray(self.cells.back(self.cells.T) - shared @ _t(shared))

    def __call__(self, inside: Array) -> Array:
        """Independent rows (A, k, w) of turned rows."""
        return self.components(self.cells(inside))

    def back(self, independent: Array) -> Array:
        """The transposed map: after :meth:`__call__`, the product with the inverse covariance."""
        return self.cells.back(self.components(independent))

    @cached_property
    def log_det(self) -> float:
        """Log determinant of the covariance of the turned rows."""
        own = np.log(np.diagonal(self.cells.T, axis1=-2, axis2=-1)).sum()
        return self.components.log_det - 2.0 * float(own)


def _square(rows: Array) -> Array:
    return np.asarray(rows.T @ rows)


def _t(a: Array) -> Array:
    return np.swapaxes(a, -1, -2)
