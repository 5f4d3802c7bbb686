"""Rows turned so that few carry the random effects.

A *cell* is a set of poses that share every draw. An orthogonal turn ``U^T`` of the rows that one
instrument reads in a cell leaves as few rows as its levers have rank; the remaining rows carry noise
alone, and enter the likelihood once, by their triangle. An effect drawn for each cell alone is *own*;
any other is *shared* by the cells of a *component*, all of which it draws alike.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib.arrays import Array, IntArray, Mask, by_size
from calib.inference.decorrelation import Groups
from calib.inference.design import Design

_MOVED = 1e-10  # of the largest singular value of the levers


@dataclass(frozen=True, eq=False)
class TurnedRows:
    """The N live rows of a design in A cells and C components; cells hold k rows, padded with zeros.

    members : tuple of ndarray (B, n), live rows of the cells of n rows; cells : tuple of ndarray (B,)
    U : ndarray, shape (N, k), slots that each row contributes to
    instrument : ndarray of int, shape (A, k), of each slot; -1 where it is empty
    outside : ndarray of int, shape (i,), number of rows of each instrument that carry noise alone
    own : ndarray, shape (A, k, q), levers; own_of : ndarray of int, shape (q,), their effects
    components : Groups, of cells
    shared : ndarray, shape (A, k, c), levers of the draws of the component
    shared_of : ndarray of int, shape (C, c), their effects
    """

    members: tuple[IntArray, ...]
    cells: tuple[IntArray, ...]
    U: Array
    instrument: IntArray
    outside: IntArray
    own: Array
    own_of: IntArray
    components: Groups
    shared: Array
    shared_of: IntArray

    @cached_property
    def outer(self) -> Array:
        """Covariance of each cell by noise and own draws of variance one, shape (i + v, A, k, k)."""
        k, effects = self.instrument.shape[1], int(self.own_of.max(initial=-1)) + 1
        slots = self.instrument[None] == np.arange(len(self.outside))[:, None, None]
        own = [self.own[..., self.own_of == j] for j in range(effects)]
        outer = [(z @ np.swapaxes(z, -1, -2))[None] for z in own]
        return np.concatenate([slots[..., None] * np.eye(k), *outer])

    def inside(self, rows: Array) -> Array:
        """``U^T rows``, shape (A, k, w), of live rows (N, w)."""
        return _turned(self.members, self.cells, self.U, rows, self.instrument.shape)

    def spread(self, inside: Array) -> Array:
        """``U inside``, shape (N, w), of turned rows (A, k, w)."""
        rows = np.zeros((len(self.U), inside.shape[-1]))
        for index, cells in zip(self.members, self.cells, strict=True):
            rows[index] = self.U[index] @ inside[cells]
        return rows

    @cached_property
    def _still(self) -> tuple[Array, ...]:
        """Orthonormal axes (B, n, l) of what turns leave of the rows of cells, as :attr:`members`."""
        axes = []
        for index in self.members:
            U = self.U[index]
            squares, V = np.linalg.eigh(np.eye(index.shape[1]) - U @ np.swapaxes(U, -1, -2))
            kept = np.flatnonzero((squares > 0.5).any(axis=0))  # each is zero or one
            axes.append(V[..., kept] * (squares[:, None, kept] > 0.5))
        return tuple(axes)

    def outside_rows(self, rows: Array) -> Array:
        """Rows (N', w) that carry noise alone, of live rows (N, w): what turns leave of cells."""
        left = [
            (np.swapaxes(V, -1, -2) @ rows[index]).reshape(-1, rows.shape[1])
            for index, V in zip(self.members, self._still, strict=True)
        ]
        return np.concatenate([np.zeros((0, rows.shape[1])), *left])

    @property
    def component_of_row(self) -> IntArray:
        """Component of each independent row: k of every cell, then those that carry noise alone."""
        component = self.components.number
        outside = [
            np.repeat(component[cells], V.shape[-1])
            for cells, V in zip(self.cells, self._still, strict=True)
        ]
        return np.concatenate([np.repeat(component, self.instrument.shape[1]), *outside])

    def sums(self, of_cells: Array) -> Array:
        """Sums over the cells of each component, shape (C, a, b), of an array (A, a, b)."""
        return self.components.sums(of_cells)


def turned_rows(design: Design) -> TurnedRows:
    """Turn the rows of a design. Raises ValueError unless groups are nested, in two levels at most."""
    each = [design.flat(e.levers) for e in design.effects]
    levers = np.concatenate([np.zeros((len(design.live), 0)), *each], axis=1)
    of_lever = np.repeat(np.arange(len(each)), [part.shape[1] for part in each]).astype(np.int_)
    cell, groups = _cells(design)
    U, instrument = _turn(levers, cell, design, len(groups))
    members = tuple(by_size(cell))
    cells = tuple(cell[index[:, 0]] for index in members)
    turned = _turned(members, cells, U, levers, instrument.shape)
    outside = np.bincount(design.instrument, minlength=design.instruments)
    outside = outside - np.bincount(instrument[instrument >= 0], minlength=design.instruments)
    own, components = _levels(groups)
    mine = own[of_lever]
    count = int(components.number.max(initial=-1)) + 1
    shared_of = np.tile(of_lever[~mine], (count, 1))
    return TurnedRows(
        members,
        cells,
        U,
        instrument,
        outside,
        turned[..., mine],
        of_lever[mine],
        components,
        turned[..., ~mine],
        shared_of,
    )


def _levels(groups: IntArray) -> tuple[Mask, Groups]:
    """Which effects (v,) are drawn for each cell alone, and the cells that share the others.

    groups : ndarray of int, shape (A, v), of each effect in each cell
    """
    numbers = [Groups.of(labels).number for labels in groups.T]
    own = np.array([len(np.unique(number)) == len(groups) for number in numbers], dtype=bool)
    shared = [number for number, alone in zip(numbers, own, strict=True) if not alone]
    if any((number != shared[0]).any() for number in shared):
        raise ValueError("the groups of random effects must be nested, in two levels at most")
    return own, Groups(shared[0] if shared else np.arange(len(groups)))


def _turned(
    members: tuple[IntArray, ...],
    cells: tuple[IntArray, ...],
    U: Array,
    rows: Array,
    shape: tuple[int, ...],
) -> Array:
    """``U^T rows`` of live rows (N, w) in ``shape`` (A, k) slots, shape (A, k, w)."""
    inside = np.zeros((*shape, rows.shape[1]))
    for index, own in zip(members, cells, strict=True):
        inside[own] = np.swapaxes(U[index], -1, -2) @ rows[index]
    return inside


def _cells(design: Design) -> tuple[IntArray, IntArray]:
    """Cell of each live row, shape (N,), and the group of each effect in each cell, (A, v)."""
    if not design.effects or not len(design.live):
        cell = np.zeros(len(design.live), dtype=np.int_)
        return cell, np.zeros((1, len(design.effects)), dtype=np.int_)
    of_pose = np.stack([e.group for e in design.effects], axis=1)
    groups, cell = np.unique(of_pose[design.pose], axis=0, return_inverse=True)
    return cell.reshape(-1), groups


def _turn(levers: Array, cell: IntArray, design: Design, count: int) -> tuple[Array, IntArray]:
    """The turn of rows with levers (N, l): U (N, k), and the instrument of each slot (A, k)."""
    scale = np.sqrt((levers**2).mean(axis=0)) if len(levers) else np.ones(levers.shape[1])
    scaled = levers / np.where(scale > 0.0, scale, 1.0)
    next_slot, turns = np.zeros(count, dtype=np.int_), []
    for i in range(design.instruments):
        rows = np.flatnonzero(design.instrument == i)
        for members in by_size(cell[rows]):
            index = rows[members]
            U, s, _ = np.linalg.svd(scaled[index], full_matrices=False)
            rank = int((s > _MOVED * s.max(initial=0.0)).sum(axis=1).max(initial=0))
            own = cell[index[:, 0]]
            turns.append((i, index, own, next_slot[own], U[..., :rank]))
            next_slot[own] += rank
    k = int(next_slot.max(initial=0))
    flat, instrument = np.zeros((len(levers), k)), np.full((count, k), -1)
    for i, index, own, first, U in turns:
        slots = first[:, None] + np.arange(U.shape[-1])
        flat[index[..., None], slots[:, None, :]] = U
        instrument[own[:, None], slots] = i
    return flat, instrument
