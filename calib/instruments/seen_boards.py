"""Boards in images: the pose of each by itself, and a camera's place where images hold too little.

Of a plane the four and more points give a homography (Zhang, PAMI 22(11), 2000), of a shape in space
six and more give a projection matrix; both are linear and are refined by the errors of the rays.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from calib.arm.se3 import nearest_rotation, rotate, skew, so3_exp, so3_log, so3_right_jacobian
from calib.arrays import Array, Mask
from calib.instruments.hand_eye import Motions
from calib.instruments.protocol import Nominal
from calib.solver import levenberg_marquardt

Shape: TypeAlias = tuple[slice, Array]
"""Positions among the readings, and the points (n, 3), m, in the board's frame."""

_FLAT = 1e-3  # thickness over width: below, a board is a plane
_LEAST = {True: 4, False: 6}
_NEAR = 1e-3  # m
_RESOLUTION = 1e-4  # of x', y': what a search takes for one standard deviation
_STARTS = 48
_FOLLOWED = 8
_SEARCHED = 240  # readings that a search looks at


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
    M = _projection(ideal, local[:, :2] if flat else local)
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


def _projection(ideal: Array, points: Array) -> Array:
    """The matrix (3, d + 1) with ``(x', y', 1) ~ M (p, 1)`` of points (n, d), up to its factor."""
    h = np.column_stack([points, np.ones(len(points))])
    zero = np.zeros_like(h)
    x, y = ideal[:, :1], ideal[:, 1:]
    A = np.concatenate([np.hstack([h, zero, -x * h]), np.hstack([zero, h, -y * h])])
    return np.asarray(np.linalg.svd(A)[2][-1].reshape(3, -1))


def _refined(ideal: Array, seen: Mask, points: Array, R: Array, t: Array) -> tuple[Array, Array]:
    """Poses (n) that fit the rays best, each image by itself."""
    weights = np.repeat(seen, 2, axis=-1) / _RESOLUTION

    def linearise(values: Array) -> tuple[Array, Array]:
        R = so3_exp(values[..., 3:])[..., None, :, :]
        predicted, by_point = _rays(rotate(R, points) + values[..., None, :3])
        turn = -R @ skew(points) @ so3_right_jacobian(values[..., 3:])[..., None, :, :]
        J = np.concatenate([by_point, by_point @ turn], axis=-1)
        r = (ideal - predicted).reshape((*values.shape[:-1], -1))
        return r * weights, J.reshape((*r.shape, 6)) * weights[..., None]

    start = np.concatenate([t, so3_log(R)], axis=-1)
    found = levenberg_marquardt(linearise, start, np.eye(6)).values
    return so3_exp(found[:, 3:]), found[:, :3]


def _rays(points: Array) -> tuple[Array, Array]:
    """``X / Z, Y / Z`` of points (..., 3) in camera axes, and the derivatives (..., 2, 3)."""
    depth = np.maximum(points[..., 2], _NEAR)
    ray = points[..., :2] / depth[..., None]
    by = np.zeros((*points.shape[:-1], 2, 3))
    by[..., 0, 0] = by[..., 1, 1] = 1.0 / depth
    by[..., 2] = -ray / depth[..., None]
    return ray, by


def resected(
    ideal: Array,
    seen: Mask,
    arm: Nominal,
    shapes: tuple[Shape, ...],
    first: tuple[Array, Array, Array] | None,
) -> tuple[Array, Array, Array]:
    """``R, t`` of a camera's base, and the markers on the tip, until the rays of all images fit.

    first : where a hand-eye calibration has them, and the frames (B, 3, 3) of the boards by rows.
        Without it the tip itself is taken for every point, which gives a projection matrix; then boards
        are turned any way about it, markers stand on it, and all move together.
    """
    pose, channel = np.nonzero(seen)
    if len(pose) > _SEARCHED:
        chosen = np.unique(np.linspace(0, len(pose) - 1, _SEARCHED).astype(int))
        pose, channel = pose[chosen], channel[chosen]
    rays, R_tip, p_tip = ideal[pose, channel], arm.R_tip[pose], arm.p_tip[pose]
    boards = [(own, points) for own, points in shapes if arm.free[own].any()]
    part = np.full(seen.shape[1], -1)  # the board of a reading, or -1
    local = np.zeros((seen.shape[1], 3))
    for k, (own, points) in enumerate(boards):
        part[own], local[own] = k, points
    read = set(channel.tolist())
    single = [j for j in range(seen.shape[1]) if part[j] < 0 and j in read and arm.free[j].any()]
    number = {j: k for k, j in enumerate(single)}
    size = 6 + 6 * len(boards) + 3 * len(single)

    def offsets(values: Array) -> tuple[Array, Array]:
        """Where the readings' points are on the tip (.., n, 3), and the derivatives (.., n, 3, p)."""
        u = np.broadcast_to(arm.markers[channel], (*values.shape[:-1], len(channel), 3)).copy()
        J = np.zeros((*u.shape, size))
        for k in range(len(boards)):
            at, own = 6 + 6 * k, part[channel] == k
            R = so3_exp(values[..., at + 3 : at + 6])[..., None, :, :]
            u[..., own, :] = rotate(R, local[channel[own]]) + values[..., None, at : at + 3]
            turn = so3_right_jacobian(values[..., at + 3 : at + 6])[..., None, :, :]
            J[..., own, :, at : at + 3] = np.eye(3)
            J[..., own, :, at + 3 : at + 6] = -R @ skew(local[channel[own]]) @ turn
        for j, k in number.items():
            at, own = 6 + 6 * len(boards) + 3 * k, channel == j
            u[..., own, :] = arm.markers[j] + values[..., None, at : at + 3]
            J[..., own, :, at : at + 3] = np.eye(3)
        return u, J

    def linearise(values: Array) -> tuple[Array, Array]:
        u, by = offsets(values)
        points = p_tip + rotate(R_tip, u)
        R = so3_exp(values[..., 3:6])[..., None, :, :]
        predicted, by_point = _rays(rotate(R, points) + values[..., None, :3])
        J = by_point @ (R @ (R_tip @ by))
        turn = -R @ skew(points) @ so3_right_jacobian(values[..., 3:6])[..., None, :, :]
        J[..., :3] = by_point
        J[..., 3:6] = by_point @ turn
        r = (rays - predicted).reshape((*values.shape[:-1], -1))
        return r / _RESOLUTION, J.reshape((*r.shape, size)) / _RESOLUTION

    if first is None:
        starts = _anyhow(len(boards), size)
        if not arm.placed:
            starts[:, :6] = _of_tip(rays, p_tip + rotate(R_tip, arm.markers[channel]))
    else:
        R, t, frames = first
        starts = np.zeros((1, size))
        starts[0, :6] = [*t, *so3_log(R)]
        free = (k for k, (own, _) in enumerate(shapes) if arm.free[own].any())
        for k, b in enumerate(free):
            x, y = frames[b, 1:]
            R = np.stack([x, y, np.cross(x, y)], axis=-1)
            starts[0, 6 + 6 * k : 12 + 6 * k] = [*frames[b, 0], *so3_log(R)]
    cost = np.sum(linearise(starts)[0] ** 2, axis=-1)
    best = starts[np.argsort(cost)[:_FOLLOWED]]
    found = levenberg_marquardt(linearise, best, np.eye(size)[:, 6 * arm.placed :])
    values = found.values[int(np.argmin(found.cost))]
    markers = arm.markers.copy()
    for k, (own, points) in enumerate(boards):
        at = 6 + 6 * k
        markers[own] = points @ so3_exp(values[at + 3 : at + 6]).T + values[at : at + 3]
    for j, k in number.items():
        at = 6 + 6 * len(boards) + 3 * k
        markers[j] += values[at : at + 3]
    return so3_exp(values[3:6]), values[:3], markers


def _anyhow(boards: int, size: int) -> Array:
    """Starts with every board on the tip, turned at random; one where there is none."""
    drawn = nearest_rotation(np.random.default_rng(0).normal(size=(_STARTS, 3, 3)))
    starts = np.zeros((_STARTS if boards else 1, size))
    for k in range(boards):
        starts[:, 9 + 6 * k : 12 + 6 * k] = so3_log(np.roll(drawn, k, axis=0))
    return starts


def _of_tip(rays: Array, points: Array) -> Array:
    """A camera's place (6,) from points (n, 3), m, in base axes that are known but roughly."""
    middle = points.mean(axis=0)
    size = float(np.sqrt(np.mean((points - middle) ** 2)))
    M = _projection(rays, (points - middle) / size)
    ahead = float(np.mean((points - middle) @ M[2, :3] / size + M[2, 3]))
    M = M * (np.sign(ahead) or 1.0)  # what is seen lies before the camera
    R = nearest_rotation(M[:, :3])
    t = M[:, 3] * size / np.linalg.svd(M[:, :3], compute_uv=False).mean()
    return np.concatenate([t - R @ middle, so3_log(R)])
