"""Boards in images: the pose of each by itself.

Of a plane the four and more points give a homography (Zhang, PAMI 22(11), 2000), of a shape in space
six and more give a projection matrix; both are linear and are refined by the errors of the rays.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from calib.arm.se3 import nearest_rotation, rotate, skew, so3_exp, so3_log, so3_right_jacobian
from calib.arrays import Array, Mask
from calib.instruments.hand_eye import Motions
from calib.solver import levenberg_marquardt

Shape: TypeAlias = tuple[slice, Array]
"""Positions among the readings, and the points (n, 3), m, in the board's frame."""

_FLAT = 1e-3  # thickness over width: below, a board is a plane
_LEAST = {True: 4, False: 6}
_NEAR = 1e-3  # m

RESOLUTION = 1e-4
"""Standard deviation of the image coordinates x', y' that a search assumes."""


def board_poses(ideal: Array, seen: Mask, shapes: tuple[Shape, ...]) -> tuple[Motions, Mask]:
    """``T_camera_board`` of every board in every image, (m, B), and where there is enough of it.

    ideal : ndarray, shape (m, C, 2), undistorted ``X / Z`` and ``Y / Z``
    """
    m, count = len(ideal), len(shapes)
    R, t = np.tile(np.eye(3), (m, count, 1, 1)), np.zeros((m, count, 3))
    whole = np.zeros((m, count), dtype=bool)
    for k, (own, points) in enumerate(shapes):
        for i in range(m):
            here = np.asarray(seen[i, own])
            found = _one(ideal[i, own][here], points[here])
            if found is not None:
                R[i, k], t[i, k] = found
                whole[i, k] = True
        if whole[:, k].any():
            here = whole[:, k]
            R[here, k], t[here, k] = _refined(
                ideal[here, own], seen[here, own], points, R[here, k], t[here, k]
            )
    return (R, t), whole


def _one(ideal: Array, points: Array) -> tuple[Array, Array] | None:
    """A board's pose by the linear way; None where too few of its points are seen, or they fail."""
    if len(points) < min(_LEAST.values()):
        return None
    middle = points.mean(axis=0)
    _, s, axes = np.linalg.svd(points - middle, full_matrices=False)
    flat = bool(s[2] < _FLAT * s[0])
    if len(points) < _LEAST[flat] or s[1] < _FLAT * s[0]:
        return None
    axes = axes * np.linalg.det(axes)
    local = (points - middle) @ axes.T / s[0]
    M = projection(ideal, local[:, :2] if flat else local)
    if flat:
        size = np.sqrt(np.linalg.norm(M[:, 0]) * np.linalg.norm(M[:, 1]))
        M = M / (size * (np.sign(M[2, 2]) or 1.0))
        R = nearest_rotation(np.stack([M[:, 0], M[:, 1], np.cross(M[:, 0], M[:, 1])], axis=-1))
    else:
        sign = np.sign(np.linalg.det(M[:, :3])) or 1.0
        M = M * sign / np.linalg.svd(M[:, :3], compute_uv=False).mean()
        R = nearest_rotation(M[:, :3])
    t, R = M[:, -1] * s[0], R @ axes
    return (R, t - R @ middle) if np.isfinite(t).all() and t[2] > 0.0 else None


def projection(ideal: Array, points: Array) -> Array:
    """The matrix (3, d + 1) with ``(x', y', 1) ~ M (p, 1)`` of points (n, d), up to its factor."""
    h = np.column_stack([points, np.ones(len(points))])
    zero = np.zeros_like(h)
    x, y = ideal[:, :1], ideal[:, 1:]
    A = np.concatenate([np.hstack([h, zero, -x * h]), np.hstack([zero, h, -y * h])])
    return np.asarray(np.linalg.svd(A)[2][-1].reshape(3, -1))


def _refined(ideal: Array, seen: Mask, points: Array, R: Array, t: Array) -> tuple[Array, Array]:
    """Poses (n) that fit the rays best, each image by itself."""
    weights = np.repeat(seen, 2, axis=-1) / RESOLUTION

    def linearise(values: Array) -> tuple[Array, Array]:
        R = so3_exp(values[..., 3:])[..., None, :, :]
        predicted, by_point = rays_to(rotate(R, points) + values[..., None, :3])
        turn = -R @ skew(points) @ so3_right_jacobian(values[..., 3:])[..., None, :, :]
        J = np.concatenate([by_point, by_point @ turn], axis=-1)
        r = (ideal - predicted).reshape((*values.shape[:-1], -1))
        return r * weights, J.reshape((*r.shape, 6)) * weights[..., None]

    start = np.concatenate([t, so3_log(R)], axis=-1)
    found = levenberg_marquardt(linearise, start, np.eye(6)).values
    return so3_exp(found[:, 3:]), found[:, :3]


def rays_to(points: Array) -> tuple[Array, Array]:
    """``X / Z, Y / Z`` of points (..., 3) in camera axes, and the derivatives (..., 2, 3)."""
    depth = np.maximum(points[..., 2], _NEAR)
    ray = points[..., :2] / depth[..., None]
    by = np.zeros((*points.shape[:-1], 2, 3))
    by[..., 0, 0] = by[..., 1, 1] = 1.0 / depth
    by[..., 2] = -ray / depth[..., None]
    return ray, by
