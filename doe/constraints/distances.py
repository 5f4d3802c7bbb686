"""Distances from points and segments to simple shapes, batched; zero where they meet.

Points have shape (..., 3), in metres, and broadcast against each other; distances have shape (...).
"""

from __future__ import annotations

import numpy as np

from calib.arrays import Array

_PARALLEL = 1e-16  # sin^2 of an angle that rounding cannot tell from zero
_HALVINGS = 50  # of a segment: to its rounding


def point_segment(point: Array, start: Array, end: Array) -> Array:
    """Distance of points to segments; all of shape (..., 3), m, with broadcasting."""
    along, offset = end - start, point - start
    t = _ratio(_dot(offset, along), _dot(along, along))
    return _norm(offset - np.clip(t, 0.0, 1.0)[..., None] * along)


def segment_segment(start_1: Array, end_1: Array, start_2: Array, end_2: Array) -> Array:
    """Distance of segments to segments; all of shape (..., 3), m, with broadcasting.

    Source: Ericson, Real-Time Collision Detection, 2005, section 5.1.9. The last step is taken
    everywhere, as it can only shorten the distance. Parallel segments may start it anywhere.
    """
    u, v, w = end_1 - start_1, end_2 - start_2, start_1 - start_2
    uu, uv, vv, uw, vw = _dot(u, u), _dot(u, v), _dot(v, v), _dot(u, w), _dot(v, w)
    across = uu * vv - uv**2
    s = np.clip(_ratio(uv * vw - uw * vv, across, _PARALLEL * uu * vv), 0.0, 1.0)
    t = np.clip(_ratio(uv * s + vw, vv), 0.0, 1.0)
    s = np.clip(_ratio(uv * t - uw, uu), 0.0, 1.0)
    return _norm(w + s[..., None] * u - t[..., None] * v)


def point_box(point: Array, half: Array) -> Array:
    """Distance of points to a box about the origin along the axes, ``half`` its size / 2.

    point : ndarray, shape (..., 3), m; half : ndarray, shape (3,), m
    """
    return _norm(_beyond(point, half))


def segment_box(start: Array, end: Array, half: Array) -> Array:
    """Distance of segments to a box about the origin along the axes, ``half`` its size / 2.

    start, end : ndarray, shape (..., 3), m; half : ndarray, shape (3,), m

    The squared distance of the point at t is convex in t: bisection finds where its slope turns.
    """
    along = end - start
    t = np.full(along.shape[:-1], 0.5)
    for k in range(2, _HALVINGS):
        point = start + t[..., None] * along
        t = t - np.sign(_dot(along, _beyond(point, half))) * 0.5**k
    return point_box(start + np.clip(t, 0.0, 1.0)[..., None] * along, half)


def segment_halfspace(start: Array, end: Array, point: Array, normal: Array) -> Array:
    """Distance of segments to all that lies beyond the plane through ``point``, along ``normal``.

    start, end : ndarray, shape (..., 3), m; point, normal : ndarray, shape (3,)
    """
    unit = normal / np.linalg.norm(normal)
    height = np.maximum(start @ unit, end @ unit) - point @ unit
    return np.asarray(np.maximum(-height, 0.0))


def _beyond(x: Array, half: Array) -> Array:
    """How far coordinates lie outside -half .. half, with sign."""
    return np.asarray(x - np.clip(x, -half, half))


def _ratio(a: Array, b: Array, tiny: Array | float = 0.0) -> Array:
    """``a / b``, and a itself where b is not above ``tiny``."""
    return np.asarray(a / np.where(b > tiny, b, 1.0))


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.einsum("...i,...i->...", a, b))


def _norm(a: Array) -> Array:
    return np.asarray(np.sqrt(_dot(a, a)))
