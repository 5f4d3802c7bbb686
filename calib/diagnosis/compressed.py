"""Columns of a regression at one fit, compressed once, and their products at any variances.

Orthogonal turns leave few rows of each configuration to carry the random effects
(:mod:`calib.inference.turned`). At variances theta the products of all columns A are those of two kinds
of rows, ``A^T V^-1 A = outside^T outside / s^2 + inside^T L^T L inside``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from calib.arrays import Array, IntArray
from calib.inference.decorrelation import Decorrelation
from calib.inference.design import Design, GaussianBlock
from calib.inference.least_squares import joined_triangle
from calib.inference.restricted import MixedModel
from calib.inference.turned import TurnedRows, turned_rows

Block = tuple[IntArray, float]
"""Columns and their prior standard deviation."""


@dataclass(frozen=True, eq=False)
class CompressedColumns:
    """Turned columns: those of the design, its response, and further ones.

    design : Design, of the user's model alone, its rows of one instrument
    inside : ndarray, shape (A, k, f), turned rows; outside : ndarray, shape (N, f), the rest
    """

    design: Design
    turned: TurnedRows
    inside: Array
    outside: Array

    @classmethod
    def of(cls, design: Design) -> CompressedColumns:
        """The columns of a design and its response."""
        turned = turned_rows(design)
        rows = np.column_stack([design.columns, design.response])
        return cls(design, turned, turned.inside(rows), turned.outside_rows(rows))

    def __len__(self) -> int:
        return int(self.inside.shape[-1])

    @property
    def response(self) -> int:
        """Position of the response, behind the columns of the design."""
        return len(self.design.block_of_column)

    def with_columns(self, rows: Array) -> CompressedColumns:
        """The same with further columns (m, R, k)."""
        flat = self.design.flat(rows)
        return replace(
            self,
            inside=np.concatenate([self.inside, self.turned.inside(flat)], axis=-1),
            outside=np.concatenate([self.outside, self.turned.outside_rows(flat)], axis=-1),
        )

    def only(self, columns: IntArray) -> CompressedColumns:
        """The same with some of the columns, those of the design and the response first."""
        return replace(self, inside=self.inside[..., columns], outside=self.outside[:, columns])

    def model(self, blocks: Sequence[Block]) -> MixedModel:
        """The mixed model with some columns as blocks of a prior standard deviation."""
        own = [self._block(columns, size) for columns, size in blocks]
        design = replace(self.design, blocks=(*self.design.blocks, *own))
        known = np.arange(self.response)
        chosen = np.concatenate([known, *(columns for columns, _ in blocks), [self.response]])
        outside = joined_triangle([self.outside[:, chosen]])[None]
        return MixedModel(design, self.turned, self.inside[..., chosen], outside)

    @staticmethod
    def _block(columns: IntArray, size: float) -> GaussianBlock:
        k = len(columns)  # the rows are turned: no others are needed
        return GaussianBlock("", np.zeros((0, 0, k)), np.eye(k), np.zeros(k), size)

    @cached_property
    def precision(self) -> Array:
        """Prior precision of the columns of the design, zero where there is none."""
        return np.where(self.design.block_of_column >= 0, 1.0, 0.0)

    def at(self, theta: Array) -> Products:
        """Products at variances theta (1 + v,)."""
        return Products(self, theta, Decorrelation(self.turned, theta))


@dataclass(frozen=True, eq=False)
class Products:
    """Products of columns at variances theta, shape (1 + v,)."""

    columns: CompressedColumns
    theta: Array
    decorrelation: Decorrelation
    _known: dict[bytes, Array] = field(default_factory=dict, init=False, repr=False)

    @cached_property
    def rows(self) -> Array:
        """Independent rows (N, f) of unit variance."""
        inside = self.decorrelation(self.columns.inside).reshape(-1, len(self.columns))
        return np.concatenate([inside, self.columns.outside / np.sqrt(self.theta[0])])

    def draws(self, own: IntArray) -> Array:
        """Products ``u^T V^-1 x`` of unit draws u with columns (k,), (d, k), effect by effect."""
        turned, root, width = self.columns.turned, self.decorrelation, len(own)
        weighted = root.back(root(self.columns.inside[..., own]))
        of_own = np.swapaxes(root.own, -1, -2) @ weighted
        of_shared = turned.sums(np.swapaxes(root.shared, -1, -2) @ weighted)
        parts = [np.zeros((0, width))]
        for effect in range(len(self.theta) - 1):
            mine = of_own[:, turned.own_of == effect].reshape(-1, width)
            parts += [mine, of_shared[turned.shared_of == effect]]
        return np.concatenate(parts)

    @cached_property
    def ends(self) -> IntArray:
        """Where the draws of each effect begin, and the end, (v + 1,)."""
        turned, effects = self.columns.turned, range(len(self.theta) - 1)
        cells = len(turned.instrument)
        counts = [
            cells * np.count_nonzero(turned.own_of == e) + np.count_nonzero(turned.shared_of == e)
            for e in effects
        ]
        return np.cumsum([0, *counts])

    def of(self, own: IntArray) -> Array:
        """Products of some columns with all, shape (k, f)."""
        return np.asarray(self.rows[:, own].T @ self.rows)

    def lengths(self, own: IntArray) -> Array:
        """Lengths (k,) of columns (k,)."""
        return np.asarray(np.linalg.norm(self.rows[:, own], axis=0))

    def squares(self, own: IntArray) -> Array:
        """Products (n, k, k) of columns (n, k) among themselves."""
        keys = [columns.tobytes() for columns in own]
        fresh = [i for i, key in enumerate(keys) if key not in self._known]
        if fresh:
            rows = np.moveaxis(self.rows[:, own[fresh]], 0, 1)
            found = np.swapaxes(rows, 1, 2) @ rows
            self._known.update({keys[i]: S for i, S in zip(fresh, found, strict=True)})
        return np.array([self._known[key] for key in keys])
