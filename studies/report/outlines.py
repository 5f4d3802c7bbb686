"""Outlines of what is drawn around the arm: hulls of points, rings, grids."""

from __future__ import annotations

import numpy as np

from calib.arrays import Array

_FLAT = 1e-6  # of the size
_TURN = np.linspace(0.0, 2.0 * np.pi, 37)
_STEPS = 4  # cells of a grid


def hull_runs(points: Array) -> list[list[int]]:
    """Points (n, 3) by their numbers, one after the other along the edges of their hull.

    Of points in a plane the one closed line around them, of points on a line that line.
    """
    from scipy.spatial import ConvexHull

    _, size, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    spread = int((size > _FLAT * max(float(size[0]), _FLAT)).sum())
    flat = points @ axes[:spread].T
    if len(points) <= spread or spread < 2:
        return [np.argsort(flat[:, 0]).tolist()] if spread else [list(range(len(points)))]
    hull = ConvexHull(flat)
    if spread == 2:
        return [[*hull.vertices.tolist(), int(hull.vertices[0])]]
    edges: dict[frozenset[int], list[Array]] = {}
    for face, plane in zip(hull.simplices.tolist(), hull.equations, strict=True):
        for a, b in ((0, 1), (1, 2), (2, 0)):
            edges.setdefault(frozenset((face[a], face[b])), []).append(plane[:3])
    sharp = (edge for edge, (one, other) in edges.items() if one @ other < 1.0 - _FLAT)
    return [sorted(edge) for edge in sharp]


def ring(centre: Array, radius: float) -> Array:
    """A level circle (k, 3)."""
    circle = np.stack([np.cos(_TURN), np.sin(_TURN), 0.0 * _TURN], axis=1)
    return np.asarray(centre + radius * circle)


def grid_lines(middle: Array, u: Array, v: Array, half: float) -> list[Array]:
    """Lines (2, 3) of a square grid about a point, along u and v, so far to each side."""
    return [
        np.stack([middle + t * a - half * b, middle + t * a + half * b])
        for a, b in ((u, v), (v, u))
        for t in np.linspace(-half, half, _STEPS + 1)
    ]
