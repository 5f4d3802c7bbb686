"""The one linear mixed model: its rows, columns, random effects and variances.

``r = J b + sum_g X_g c_g + sum_v Z_v u_v + e``

with b unknown, ``c_g ~ N(m_g, a_g^2 R_g R_g^T)``, ``u_v ~ N(0, s_v^2 I)`` drawn anew in every group of
effect v, and e independent with one variance an instrument. Rows are arranged by pose: m poses, up to
R rows a pose. Nothing here knows a robot; a caller may state rows in any unit.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib.arrays import Array, IntArray
from calib.inference.least_squares import independent_columns


@dataclass(frozen=True, eq=False)
class GaussianBlock:
    """Coefficients ``c ~ N(mean, amplitude^2 root root^T)`` of some columns.

    columns : ndarray, shape (m, R, k), change of each row per unit of each coefficient
    root : ndarray, shape (k, l), in units of the coefficients; l below k restricts them to a subspace
    mean : ndarray, shape (k,)
    amplitude : float, or None where restricted likelihood estimates it
    """

    name: str
    columns: Array
    root: Array
    mean: Array
    amplitude: float | None = 1.0


@dataclass(frozen=True, eq=False)
class RandomEffect:
    """An effect that is drawn anew in each group of poses, with one variance.

    levers : ndarray, shape (m, R, l), change of each row per unit of each of the l components
    kind : str, sort of effect: the key of its scale in :class:`calib.inference.reml.Prior`
    group : ndarray of int, shape (m,), in which poses share one draw (an approach, a configuration)
    """

    name: str
    levers: Array
    kind: str
    group: IntArray


@dataclass(frozen=True, eq=False)
class Variances:
    """The variances of a design.

    instrument : ndarray, shape (i,), squared units of the rows
    effects : ndarray, shape (v,), squared units of each effect
    amplitudes : ndarray, shape (g,), standard deviations a_g of all blocks, stated ones included
    """

    instrument: Array
    effects: Array
    amplitudes: Array


@dataclass(frozen=True, eq=False)
class Design:
    """Rows and columns of the model.

    r : ndarray, shape (m, R); J : ndarray, shape (m, R, p), derivatives by b
    span : ndarray, shape (p, k), directions in which b is estimated
    instrument_of_row : ndarray of int, shape (m, R), from 0 on; -1 where there is no row
    """

    r: Array
    J: Array
    span: Array
    blocks: tuple[GaussianBlock, ...]
    effects: tuple[RandomEffect, ...]
    instrument_of_row: IntArray

    @cached_property
    def live(self) -> IntArray:
        """Positions (N,) of the rows that take part, in the flat order of (m, R)."""
        return np.asarray(np.flatnonzero(self.instrument_of_row >= 0))

    @cached_property
    def pose(self) -> IntArray:
        """Pose of each live row, shape (N,)."""
        return np.asarray(self.live // max(1, self.r.shape[1]))

    @cached_property
    def instrument(self) -> IntArray:
        """Instrument of each live row, shape (N,)."""
        return np.asarray(self.instrument_of_row.reshape(-1)[self.live])

    @cached_property
    def instruments(self) -> int:
        """Number of instruments."""
        return int(self.instrument_of_row.max(initial=-1)) + 1

    @property
    def freedom(self) -> int:
        """Degrees of freedom of the residual: rows less directions of b."""
        return len(self.live) - int(self.directions.shape[1])

    def flat(self, rows: Array) -> Array:
        """Live rows (N, k) of rows (m, R, k)."""
        return np.asarray(rows.reshape(self.r.size, rows.shape[-1])[self.live])

    @cached_property
    def directions(self) -> Array:
        """Independent directions (p, s) of b: those of the span that the rows determine."""
        columns = self.flat(self.J @ self.span)
        return np.asarray(self.span[:, independent_columns(columns)])

    @cached_property
    def columns(self) -> Array:
        """Columns (N, f) of the s directions of b and of ``X_g R_g`` for every block."""
        fixed = self.flat(self.J @ self.directions)
        own = [self.flat(g.columns @ g.root) for g in self.blocks]
        return np.concatenate([fixed, *own], axis=1)

    @cached_property
    def response(self) -> Array:
        """Rows (N,) of ``r - sum_g X_g m_g``."""
        expected = sum((g.columns @ g.mean for g in self.blocks), np.zeros_like(self.r))
        return self.flat((self.r - expected)[..., None])[:, 0]

    @cached_property
    def block_of_column(self) -> IntArray:
        """Block of each column, shape (f,); -1 for directions of b."""
        sizes = [g.root.shape[1] for g in self.blocks]
        own = np.repeat(np.arange(len(sizes)), sizes)
        return np.append(np.full(self.directions.shape[1], -1), own).astype(np.int_)

    def column_scale(self, amplitudes: Array) -> Array:
        """Amplitude of each column, shape (f,), of blocks (g,); one for directions of b."""
        return np.asarray(np.append(amplitudes, 1.0)[self.block_of_column])

    @property
    def prior_rows(self) -> Array:
        """Rows (h, f) of unit variance and value zero, for columns in units of their amplitude."""
        return np.eye(len(self.block_of_column))[self.block_of_column >= 0]

    @property
    def free_blocks(self) -> tuple[int, ...]:
        """Positions of the blocks whose amplitude is estimated."""
        return tuple(i for i, g in enumerate(self.blocks) if g.amplitude is None)

    def amplitudes(self, free: Array) -> Array:
        """Amplitudes of all blocks, shape (g,), those of the free ones given."""
        amplitudes = np.array([1.0 if g.amplitude is None else g.amplitude for g in self.blocks])
        amplitudes[list(self.free_blocks)] = free
        return amplitudes

    def theta(self, variances: Variances) -> Array:
        """Variances in one vector: instruments, effects, squared amplitudes of free blocks."""
        free = variances.amplitudes[list(self.free_blocks)]
        return np.concatenate([variances.instrument, variances.effects, free**2])

    def variances(self, theta: Array) -> Variances:
        """Inverse of :meth:`theta`."""
        i, v = self.instruments, len(self.effects)
        amplitudes = self.amplitudes(np.sqrt(theta[i + v :]))
        return Variances(theta[:i], theta[i : i + v], amplitudes)
