"""Where points of known shape stand before a camera, from one image: both poses that look alike.

A plane, or what is thin or far, looks nearly the same in two poses, one the other's reflection in depth
(Oberkampf, DeMenthon, Davis, CVIU 63(3), 1996; Collins, Bartoli, IJCV 109(3), 2014). Points p about
their middle, which lies at depth d, are seen at x with ``(1 + w) x = (R p + t)_xy / d`` and
``w = R_3 p / d``: once w is known, two rows of R over d follow linearly. Their columns across the
shape decide: they give the third row but for its sign, that gives w, and so on in turn (POSIT).
"""

from __future__ import annotations

import numpy as np

from calib.arm.se3 import cross, moved_as_one, nearest_rotation, rotate, so3_exp, so3_log
from calib.arrays import Array, Mask
from calib.solver import levenberg_marquardt

LEAST = 4
"""Points that give a pose."""

RESOLUTION = 1e-4
"""Standard deviation of the image coordinates x', y' that a search assumes."""

_LINE = 1e-3  # width over length: below, points lie on a line
_THIN = 0.02  # thickness over length: below, points lie on a plane
_ROUNDS = 5
_NEAR = 1e-3  # m


def posed(rays: Array, points: Array) -> tuple[Array, Array, Mask]:
    """Rotations (..., 2, 3, 3) and translations (..., 2, 3) of points in the camera; which are sound.

    rays : ndarray, shape (..., n, 2), ``X / Z`` and ``Y / Z``; points : ndarray, shape (..., n, 3), m
    """
    middle = points.mean(axis=-2, keepdims=True)
    _, s, axes = np.linalg.svd(points - middle, full_matrices=False)
    sound = s[..., 1] > _LINE * s[..., 0]
    axes = axes * np.linalg.det(axes)[..., None, None]
    size = np.maximum(s[..., :1], 1e-300)[..., None]
    local = (points - middle) @ np.swapaxes(axes, -1, -2) / size
    across, ahead = _ahead(rays)
    columns = np.concatenate([local, np.ones((*local.shape[:-1], 1))], axis=-1)
    solve = np.linalg.pinv(columns, rcond=_THIN)
    w = np.zeros((*across.shape[:-2], 2, across.shape[-2]))
    for _ in range(_ROUNDS):
        found = solve[..., None, :, :] @ (across[..., None, :, :] * (1.0 + w)[..., None])
        R, per_depth = _completed(np.swapaxes(found[..., :2, :], -1, -2))
        w = rotate(local[..., None, :, :], R[..., 2, :]) * per_depth[..., None]
    depth = size[..., 0] / per_depth
    t = np.concatenate([found[..., 3, :], np.ones((*depth.shape, 1))], axis=-1) * depth[..., None]
    R = ahead[..., None, :, :] @ R @ axes[..., None, :, :]
    t = rotate(ahead[..., None, :, :], t) - rotate(R, np.broadcast_to(middle, t.shape))
    centre = rotate(R, np.broadcast_to(middle, t.shape)) + t
    finite = np.isfinite(t).all(axis=-1) & np.isfinite(R).all(axis=(-1, -2))
    return R, t, (finite & (centre[..., 2] > _NEAR)).all(axis=-1) & sound


def _ahead(rays: Array) -> tuple[Array, Array]:
    """Rays (..., n, 2) of a camera that looks at their middle, and its axes (..., 3, 3)."""
    whole = np.concatenate([rays, np.ones((*rays.shape[:-1], 1))], axis=-1)
    z = whole.mean(axis=-2)
    z = z / np.linalg.norm(z, axis=-1, keepdims=True)
    y = cross(z, np.broadcast_to([1.0, 0.0, 0.0], z.shape))
    y = y / np.maximum(np.linalg.norm(y, axis=-1, keepdims=True), 1e-300)
    axes = np.stack([cross(y, z), y, z], axis=-1)
    own = whole @ axes
    return own[..., :2] / np.maximum(own[..., 2:], _NEAR), axes


def _completed(A: Array) -> tuple[Array, Array]:
    """Both rotations (..., 2, 3, 3) whose upper left corners are A (..., 2, 2, 2) over their depths."""
    per_depth = np.maximum(np.linalg.svd(A, compute_uv=False)[..., 0], 1e-300)
    x, y = np.moveaxis(A / per_depth[..., None, None], -1, 0)
    third_x = np.sqrt(np.maximum(1.0 - (x**2).sum(axis=-1), 0.0))
    third_y = np.sqrt(np.maximum(1.0 - (y**2).sum(axis=-1), 0.0))
    third_y = np.where((x * y).sum(axis=-1) > 0.0, -third_y, third_y)
    sign = np.array([1.0, -1.0])
    x = np.concatenate([x, (sign * third_x)[..., None]], axis=-1)
    y = np.concatenate([y, (sign * third_y)[..., None]], axis=-1)
    return nearest_rotation(np.stack([x, y, cross(x, y)], axis=-1)), per_depth


def refined(
    ideal: Array, seen: Mask, points: Array, R: Array, t: Array
) -> tuple[Array, Array, Array]:
    """Poses (...) that fit the rays (..., C, 2) best, each by itself, and their costs."""
    weights = np.repeat(seen, 2, axis=-1) / RESOLUTION

    def linearise(values: Array) -> tuple[Array, Array]:
        viewed, _, by_values = moved_as_one(values, points)
        predicted, by_point = rays_to(viewed)
        J = by_point @ by_values
        r = (ideal - predicted).reshape((*values.shape[:-1], -1))
        return r * weights, J.reshape((*r.shape, 6)) * weights[..., None]

    found = levenberg_marquardt(
        linearise, np.concatenate([t, so3_log(R)], axis=-1), np.eye(6), _STEPS
    )
    return so3_exp(found.values[..., 3:]), found.values[..., :3], found.cost


_STEPS = 20  # they start near


def rays_to(points: Array) -> tuple[Array, Array]:
    """``X / Z, Y / Z`` of points (..., 3) in camera axes, and the derivatives (..., 2, 3)."""
    depth = np.maximum(points[..., 2], _NEAR)
    ray = points[..., :2] / depth[..., None]
    by = np.zeros((*points.shape[:-1], 2, 3))
    by[..., 0, 0] = by[..., 1, 1] = 1.0 / depth
    by[..., 2] = -ray / depth[..., None]
    return ray, by
