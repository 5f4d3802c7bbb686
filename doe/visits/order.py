"""The order of measuring with the shortest joint travel."""

from __future__ import annotations

import numpy as np

from calib.arrays import Array, IntArray

_STARTS = 8


def travel(q: Array) -> float:
    """Joint travel of a sequence q, shape (m, n), of joints of one unit: of each move the farthest."""
    return float(np.abs(np.diff(q, axis=0)).max(axis=1, initial=0.0).sum())


def visiting_order(q: Array) -> IntArray:
    """Order of poses (m, dof) with short travel: nearest neighbours, then 2-opt until nothing helps.

    All joints move together, so a move takes as long as its largest joint motion. The way is open: it
    ends anywhere.
    """
    distance = np.abs(q[:, None, :] - q[None, :, :]).max(axis=-1)
    starts = np.unique(np.linspace(0, len(q) - 1, min(_STARTS, len(q))).astype(int))
    ways = [_two_opt(_nearest(distance, int(start)), distance) for start in starts]
    return min(ways, key=lambda way: float(distance[way[:-1], way[1:]].sum()))


def _nearest(distance: Array, start: int) -> IntArray:
    way, left = [start], np.ones(len(distance), dtype=bool)
    left[start] = False
    while left.any():
        nearest = int(np.where(left, distance[way[-1]], np.inf).argmin())
        way.append(nearest)
        left[nearest] = False
    return np.array(way)


def _two_opt(way: IntArray, distance: Array) -> IntArray:
    """Reverse stretches while that shortens the open way (Croes, Operations Research 6(6), 1958)."""
    padded = np.pad(
        distance, (0, 1)
    )  # a place without distance before the first and after the last
    ends = len(distance)
    while True:
        around = np.concatenate([[ends], way, [ends]])
        best, cut = -1e-9, None
        for i in range(1, len(way)):
            a, b = around[i - 1], around[i]
            c, d = around[i + 1 : -1], around[i + 2 :]
            change = padded[a, c] + padded[b, d] - padded[a, b] - padded[c, d]
            if change.min() < best:
                best, cut = float(change.min()), (i, i + 1 + int(change.argmin()))
        if cut is None:
            return way
        i, j = cut
        around[i : j + 1] = around[i : j + 1][::-1]
        way = around[1:-1]
