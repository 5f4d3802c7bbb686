"""How points look from a link: an instrument that rides on it reads them in the link's own axes.

Three points stand for the link, its origin and the ends of its x and y axes, a metre long. What moves
the link and the points alike is then not seen, joint by joint, to rounding.
"""

from __future__ import annotations

import numpy as np

from calib.arm.se3 import cross, nearest_rotation, rotate, so3_log
from calib.arrays import Array
from calib.instruments.protocol import Instrument

DIFFERENCES = np.array([[1.0, 0.0, 0.0], [-1.0, 1.0, 0.0], [-1.0, 0.0, 1.0]])
"""Origin and two axes of the three points of a body."""
_CORNERS = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])

CORNERS = 3
"""Points that stand for a body."""


def corners_of(R: Array, p: Array) -> Array:
    """The three points (..., 3, 3) of a body that stands at R (..., 3, 3), p (..., 3)."""
    return np.asarray(_CORNERS @ np.swapaxes(R, -1, -2) + p[..., None, :])


def twist_of(R: Array, p: Array) -> Array:
    """Where a body stands as a place (6,): translation, m, and rotation vector."""
    return np.concatenate([p, so3_log(R)])


def rigid(corners: Array) -> Array:
    """The three points (..., 3, 3) of the body that stands nearest to three that bend, origin kept."""
    origin, axes = frame_of(corners)
    return corners_of(nearest_rotation(np.swapaxes(axes, -1, -2)), origin)


def frame_of(corners: Array) -> tuple[Array, Array]:
    """Origin (..., 3) and axes (..., 3, 3), by rows, of a body's three points (..., 3, 3)."""
    frame = np.einsum("ab,...bi->...ai", DIFFERENCES, corners)
    x, y = frame[..., 1, :], frame[..., 2, :]
    return frame[..., 0, :], np.stack([x, y, cross(x, y)], axis=-2)


def by_corners(axes: Array, ray: Array) -> Array:
    """How ``axes @ ray`` follows a body's three points, shape (..., 3, 9), the ray's end at rest.

    axes : ndarray, shape (..., 3, 3), by rows; ray : ndarray, shape (..., 3), m, from its origin
    """
    x, y = axes[..., 0, :], axes[..., 1, :]
    none = np.zeros_like(ray)
    by_x = np.stack([ray, none, cross(y, ray)], axis=-2)  # of (x, y, x cross y) . ray
    by_y = np.stack([none, ray, cross(ray, x)], axis=-2)
    return np.concatenate([-axes - by_x - by_y, by_x, by_y], axis=-1)


def seen_from(instrument: Instrument, points: Array) -> Array:
    """Points (..., M, 3), m, of base axes in those of the link under an instrument, if any."""
    if instrument.seat is None:
        return points
    origin, axes = frame_of(points[..., instrument.seat, :])
    return rotate(axes[..., None, :, :], points - origin[..., None, :])


def taken(instrument: Instrument, points: Array) -> Array:
    """What each reading takes of points (m, M, 3), m, base axes: k of them, shape (m, C, 3 k)."""
    own = seen_from(instrument, points)[:, instrument.read_of(points.shape[1])]
    return own.reshape(len(own), -1, 3 * instrument.each)


def moves_seen(instrument: Instrument, points: Array, moved: Array) -> Array:
    """How these follow what moves the points by (..., M, 3, k), shape (..., M, 3, k)."""
    if instrument.seat is None:
        return moved
    origin, axes = frame_of(points[..., instrument.seat, :])
    axes = axes[..., None, :, :]
    by = by_corners(axes, points - origin[..., None, :])
    corners = moved[..., instrument.seat, :, :]
    corners = corners.reshape((*corners.shape[:-3], 9, corners.shape[-1]))
    under = by.reshape((*by.shape[:-3], -1, 9)) @ corners
    return np.asarray(axes @ moved + under.reshape(moved.shape))
