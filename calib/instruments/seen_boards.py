"""Boards in images: the pose of each by itself.

Of a plane the four and more points give a homography (Zhang, PAMI 22(11), 2000), of a shape in space
six and more give a projection matrix; both are linear and are refined by the errors of the rays.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TypeAlias

import numpy as np

from calib.arm.se3 import (
    cross,
    nearest_rotation,
    rotate,
    skew,
    so3_exp,
    so3_log,
    so3_right_jacobian,
)
from calib.arrays import Array, IntArray, Mask
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
        for here, images in _alike(seen[:, own]):
            found = _linearly(ideal[images, own][:, here], points[here])
            if found is not None:
                R[images, k], t[images, k], whole[images, k] = found
        if whole[:, k].any():
            good = whole[:, k]
            R[good, k], t[good, k] = _refined(
                ideal[good, own], seen[good, own], points, R[good, k], t[good, k]
            )
    return (R, t), whole


def _alike(seen: Mask) -> Iterator[tuple[Mask, IntArray]]:
    """What is seen (C,), and the images (n,) in which it is that."""
    patterns, which = np.unique(seen, axis=0, return_inverse=True)
    for k, here in enumerate(patterns):
        yield here, np.flatnonzero(which.reshape(-1) == k)


def _linearly(ideal: Array, points: Array) -> tuple[Array, Array, Mask] | None:
    """A board's poses (n) by the linear way, and which are sound; None where too little is seen.

    ideal : ndarray, shape (n, C, 2); points : ndarray, shape (C, 3)
    """
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
        size = np.sqrt(np.linalg.norm(M[:, :, 0], axis=-1) * np.linalg.norm(M[:, :, 1], axis=-1))
        M = M / (size * _sign(M[:, 2, 2]))[:, None, None]
        x, y = M[:, :, 0], M[:, :, 1]
        R = nearest_rotation(np.stack([x, y, cross(x, y)], axis=-1))
    else:
        size = np.linalg.svd(M[:, :, :3], compute_uv=False).mean(axis=-1)
        M = M * (_sign(np.linalg.det(M[:, :, :3])) / size)[:, None, None]
        R = nearest_rotation(M[:, :, :3])
    t, R = M[:, :, -1] * s[0], R @ axes
    return R, t - R @ middle, np.isfinite(t).all(axis=-1) & (t[:, 2] > 0.0)


def _sign(a: Array) -> Array:
    return np.where(a < 0.0, -1.0, 1.0)


def projection(ideal: Array, points: Array) -> Array:
    """The matrices (..., 3, d + 1) with ``(x', y', 1) ~ M (p, 1)``, up to their factor.

    ideal : ndarray, shape (..., n, 2); points : ndarray, shape (n, d)
    """
    h = np.column_stack([points, np.ones(len(points))])
    width = h.shape[-1]
    A = np.zeros((*ideal.shape[:-1], 2, 3, width))
    A[..., 0, 0, :] = A[..., 1, 1, :] = h
    A[..., 2, :] = -ideal[..., None] * h[:, None]
    A = A.reshape((*ideal.shape[:-2], -1, 3 * width))
    Vt = np.linalg.svd(np.linalg.qr(A, mode="r"))[2]
    return np.asarray(Vt[..., -1, :].reshape((*ideal.shape[:-2], 3, width)))


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
