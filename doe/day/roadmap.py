"""Ways round where the straight one meets something: a lazy probabilistic roadmap.

Kavraki, Svestka, Latombe, Overmars, IEEE Transactions on Robotics and Automation 12(4), 1996; Bohlin,
Kavraki, ICRA 2000. Its nodes are the poses and an even choice of configurations where nothing is met,
its edges straight motions between neighbours. Of these only those are proved (:mod:`doe.day.straight`)
that the quickest way goes over, until all of it is; after some tries, all of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from calib.arrays import Array, IntArray
from calib.cell import Cell
from doe.constraints import scene_of
from doe.constraints.clearance import Lasting
from doe.day.duration import durations
from doe.day.straight import straight

_SIZES = ((0, 40), (256, 15), (2048, 15))
"""Configurations beside the poses, and neighbours of each; more where there is no way yet."""
_PATIENCE = 10  # quickest ways that are looked at one by one
_MOST_LOOKS, _AT_ONCE = 80_000, 1000  # configurations in one search; edges
_PARTS = 4  # of each edge of a way that is shortened


def ways_round(
    cell: Cell, kept: Sequence[Lasting], start: Array, end: Array, poses: Array
) -> list[Array | None]:
    """Points (k, dof) of a way from each of n configurations (n, dof) to another, both among them.

    None where none was found.

    poses : ndarray, shape (m, dof), configurations over which a way may lead
    """
    found: list[Array | None] = [None] * len(start)
    for count, neighbours in _SIZES:
        left = np.array([i for i, way in enumerate(found) if way is None], dtype=int)
        if not len(left):
            break
        drawn = np.concatenate([poses, cell.robot.sobol(count)]) if count else poses
        scene = scene_of(cell, drawn)
        drawn = drawn[np.all([own.allows(scene) for own in kept], axis=0)]
        nodes = np.concatenate([start[left], end[left], drawn])
        for i, way in zip(left, _joined(cell, kept, nodes, len(left), neighbours), strict=True):
            found[i] = None if way is None else _shortened(cell, kept, nodes[way])
    return found


def _joined(
    cell: Cell, kept: Sequence[Lasting], nodes: Array, count: int, neighbours: int
) -> list[list[int] | None]:
    """The nodes on a proved way from each of the first ``count`` nodes to that as many later."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import dijkstra

    a, b = _neighbours(cell, nodes, neighbours)
    # To the graph, an edge of no time is none.
    seconds = np.maximum(durations(cell, nodes[b] - nodes[a]), 1e-9)
    number = {pair: i for i, pair in enumerate(zip(a.tolist(), b.tolist(), strict=True))}
    proved, there, looks = np.zeros(len(a), dtype=bool), np.ones(len(a), dtype=bool), 0
    for patience in reversed(range(_PATIENCE + 1)):
        graph = csr_array((seconds[there], (a[there], b[there])), shape=(len(nodes),) * 2)
        _, before = dijkstra(
            graph, directed=False, indices=np.arange(count), return_predecessors=True
        )
        ways = [_back(before[k], k, count + k) for k in range(count)]
        steps = [
            number[min(pair), max(pair)]
            for way in ways
            if way is not None
            for pair in pairwise(way)
        ]
        asked = np.unique(steps).astype(int)
        asked = asked[~proved[asked]]
        if not len(asked):
            break
        # Where the quickest ways are broken again and again, all is proved at once, while that is
        # affordable: what is not proved by then is no edge.
        asked = asked if patience > 1 else np.flatnonzero(there & ~proved)
        for part in np.array_split(asked, -(-len(asked) // _AT_ONCE)):
            if looks < _MOST_LOOKS:
                found = straight(cell, kept, nodes[a[part]], nodes[b[part]])
                proved[part], looks = found.free, looks + found.looked
        there[asked] = proved[asked]
    return ways


def _back(before: IntArray, start: int, end: int) -> list[int] | None:
    """The nodes from a start to an end by what comes before each (N,), None without a way."""
    way = [end]
    while way[-1] != start:
        if before[way[-1]] < 0:
            return None
        way.append(int(before[way[-1]]))
    return way[::-1]


def _neighbours(cell: Cell, nodes: Array, neighbours: int) -> tuple[IntArray, IntArray]:
    """Pairs of nodes of which one is near the other, the earlier first."""
    from scipy.spatial import KDTree

    unit = durations(cell, np.eye(cell.robot.dof))
    count = min(neighbours + 1, len(nodes))
    _, near = KDTree(nodes / unit).query(nodes / unit, count, p=np.inf)
    pairs = np.stack([np.repeat(np.arange(len(nodes)), count), near.reshape(-1)])
    a, b = np.unique(np.sort(pairs, axis=0), axis=1)
    return a[a < b], b[a < b]


def _shortened(cell: Cell, kept: Sequence[Lasting], points: Array) -> Array:
    """The quickest way through points that lie on a proved way (k, dof), in their order."""
    share = np.linspace(0.0, 1.0, _PARTS, endpoint=False)[:, None]
    fine = [a + share * (b - a) for a, b in pairwise(points)]
    nodes = np.concatenate([*fine, points[-1:]])
    a, b = np.triu_indices(len(nodes), 1)
    free = straight(cell, kept, nodes[a], nodes[b]).free
    seconds = np.full((len(nodes),) * 2, np.inf)
    seconds[a[free], b[free]] = durations(cell, nodes[b] - nodes[a])[free]
    best, before = np.full(len(nodes), np.inf), np.zeros(len(nodes), dtype=int)
    best[0] = 0.0
    for j in range(1, len(nodes)):
        before[j] = int(np.argmin(best + seconds[:, j]))
        best[j] = best[before[j]] + seconds[before[j], j]
    way = _back(before, 0, len(nodes) - 1)
    return points if way is None else nodes[way]
