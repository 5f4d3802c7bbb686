"""Rows turned so that few carry the random effects.

A *cell* is a set of poses that share every draw. An orthogonal turn ``U^T`` of the rows that one
instrument reads in a cell leaves as few rows as its levers have rank; the remaining rows carry noise
alone, and enter the likelihood once, by their triangle. A *component* is a set of cells that are linked
by shared draws. An effect drawn for one cell alone is *own*, any other is *shared*.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from calib.arrays import Array, IntArray, by_size
from calib.inference.design import Design

_MOVED = 1e-10  # of the largest singular value of the levers


@dataclass(frozen=True, eq=False)
class TurnedRows:
    """The N live rows of a design in A cells and C components; cells hold k rows, padded with zeros.

    members : tuple of ndarray (B, n), live rows of the cells of n rows; cells : tuple of ndarray (B,)
    cell : ndarray of int, shape (N,), of each row; U : ndarray, shape (N, k), slots it contributes to
    instrument : ndarray of int, shape (A, k), of each slot; -1 where it is empty
    outside : ndarray of int, shape (i,), number of rows of each instrument that carry noise alone
    own : ndarray, shape (A, k, q), levers; own_of : ndarray of int, shape (q,), their effects
    component : ndarray of int, shape (A,)
    shared : ndarray, shape (A, k, c), levers of the draws of the component; empty ones zero
    shared_of : ndarray of int, shape (C, c), their effects; -1 where a draw is empty
    """

    members: tuple[IntArray, ...]
    cells: tuple[IntArray, ...]
    cell: IntArray
    U: Array
    instrument: IntArray
    outside: IntArray
    own: Array
    own_of: IntArray
    component: IntArray
    shared: Array
    shared_of: IntArray

    @cached_property
    def outer(self) -> Array:
        """Covariance of each cell by noise and own draws of variance one, shape (i + v, A, k, k)."""
        k, effects = self.instrument.shape[1], int(self.own_of.max(initial=-1)) + 1
        slots = self.instrument[None] == np.arange(len(self.outside))[:, None, None]
        noise = slots[..., None] * np.eye(k)
        own = [self.own[..., self.own_of == j] for j in range(effects)]
        return np.concatenate([noise, *((z @ np.swapaxes(z, -1, -2))[None] for z in own)])

    def inside(self, rows: Array) -> Array:
        """``U^T rows``, shape (A, k, w), of live rows (N, w)."""
        found = np.zeros((*self.instrument.shape, rows.shape[1]))
        for index, cells in zip(self.members, self.cells, strict=True):
            found[cells] = np.swapaxes(self.U[index], -1, -2) @ rows[index]
        return found

    def spread(self, inside: Array) -> Array:
        """``U inside``, shape (N, w), of turned rows (A, k, w)."""
        found = np.zeros((len(self.U), inside.shape[-1]))
        for index, cells in zip(self.members, self.cells, strict=True):
            found[index] = self.U[index] @ inside[cells]
        return found

    @cached_property
    def _still(self) -> tuple[Array, ...]:
        """Orthonormal axes (B, n, l) of what turns leave of the rows of cells, as :attr:`members`."""
        found = []
        for index in self.members:
            U = self.U[index]
            squares, V = np.linalg.eigh(np.eye(index.shape[1]) - U @ np.swapaxes(U, -1, -2))
            kept = np.flatnonzero((squares > 0.5).any(axis=0))  # each is zero or one
            found.append(V[..., kept] * (squares[:, None, kept] > 0.5))
        return tuple(found)

    def outside_rows(self, rows: Array) -> Array:
        """Rows (N', w) that carry noise alone, of live rows (N, w): what turns leave of cells."""
        found = [np.zeros((0, rows.shape[1]))]
        for index, V in zip(self.members, self._still, strict=True):
            found.append((np.swapaxes(V, -1, -2) @ rows[index]).reshape(-1, rows.shape[1]))
        return np.concatenate(found)

    @property
    def component_of_row(self) -> IntArray:
        """Component of each independent row: k of every cell, then those that carry noise alone."""
        inside = np.repeat(self.component, self.instrument.shape[1])
        outside = [
            np.repeat(self.component[cells], V.shape[-1])
            for cells, V in zip(self.cells, self._still, strict=True)
        ]
        return np.concatenate([inside, *outside])

    def sums(self, of_cells: Array) -> Array:
        """Sums over the cells of each component, shape (C, ..), of an array (A, ..)."""
        flat = of_cells.reshape(len(of_cells), math.prod(of_cells.shape[1:]))
        return np.asarray(
            (self._membership @ flat).reshape(len(self.shared_of), *of_cells.shape[1:])
        )

    @cached_property
    def _membership(self) -> Any:
        """Sparse matrix (C, A) of the cells of each component."""
        from scipy.sparse import csr_array

        A, C = len(self.component), len(self.shared_of)
        return csr_array((np.ones(A), (self.component, np.arange(A))), shape=(C, A))


def turned_rows(design: Design) -> TurnedRows:
    """Turn the rows of a design."""
    effects = design.effects
    levers = np.concatenate(
        [np.zeros((len(design.live), 0)), *(design.flat(e.levers) for e in effects)], axis=1
    )
    of_lever = np.repeat(np.arange(len(effects)), [e.levers.shape[-1] for e in effects])
    cell, groups = _cells(design)
    U, instrument = _turn(levers, cell, design, len(groups))
    members = tuple(by_size(cell))
    cells = tuple(cell[index[:, 0]] for index in members)
    turned = np.zeros((*instrument.shape, levers.shape[1]))
    for index, own in zip(members, cells, strict=True):
        turned[own] = np.swapaxes(U[index], -1, -2) @ levers[index]
    draws = _draws(groups, turned, of_lever)
    count = design.instruments
    all_rows = np.bincount(design.instrument, minlength=count)
    outside = all_rows - np.bincount(instrument[instrument >= 0], minlength=count)
    return TurnedRows(members, cells, cell, U, instrument, outside, *draws)


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
    next_slot = np.zeros(count, dtype=np.int_)
    turns = []
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


_Draws = tuple[Array, IntArray, IntArray, Array, IntArray]


def _draws(groups: IntArray, turned: Array, of_lever: IntArray) -> _Draws:
    """The last five fields of :class:`TurnedRows`, from turned levers (A, k, l)."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    A, v = groups.shape
    draw = np.zeros((A, v), dtype=np.int_)  # of each effect in each cell
    total = 0
    for j in range(v):
        draw[:, j] = total + np.unique(groups[:, j], return_inverse=True)[1].reshape(-1)
        total = int(draw[:, j].max(initial=total - 1)) + 1
    links = (np.ones(A * v), (np.repeat(np.arange(A), v), A + draw.ravel()))
    C, label = connected_components(coo_array(links, shape=(A + total, A + total)), directed=False)
    component = label[:A].astype(np.int_)
    alone = np.bincount(draw.ravel(), minlength=total) == 1
    own = turned * alone[draw][:, None, of_lever]
    next_column = np.zeros(C, dtype=np.int_)
    first = np.zeros(total, dtype=np.int_)
    filled = []
    for j in range(v):
        levers = np.flatnonzero(of_lever == j)
        cells = np.flatnonzero(~alone[draw[:, j]])
        for d, a in zip(*np.unique(draw[cells, j], return_index=True), strict=True):
            first[d] = next_column[component[cells[a]]]
            next_column[component[cells[a]]] += len(levers)
        columns = first[draw[cells, j]][:, None] + np.arange(len(levers))
        filled.append((j, cells, columns, levers))
    c = int(next_column.max(initial=0))
    shared, shared_of = np.zeros((*turned.shape[:2], c)), np.full((C, c), -1)
    for j, cells, columns, levers in filled:
        values = np.swapaxes(turned[cells][..., levers], 1, 2)
        shared[cells[:, None], :, columns] = values
        shared_of[component[cells][:, None], columns] = j
    return own, of_lever.astype(np.int_), component, shared, shared_of
