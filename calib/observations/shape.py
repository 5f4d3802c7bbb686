"""A set of markers: what it says of a rigid motion, and its shape from nothing but the readings.

Approach #1 needs the shape before it can compute a pose, and takes it from the same readings: the shape
and the poses that fit all points best (generalised Procrustes). Its error is common to all poses.
"""

from __future__ import annotations

import numpy as np

from calib.arm.se3 import fit_rigid, rotate, skew, so3_exp, transformed
from calib.arrays import Array, Mask
from calib.effects.tool_base import Tool
from calib.model import Model
from calib.poses import Measurements

_ROUNDS = 50
_SETTLED_M = 1e-11
_COLLINEAR = 1e-3  # ratio of marker spreads below which no orientation can be computed


def rigid_motions(points: Array) -> Array:
    """Changes of points (..., M, 3) by translation and rotation about the origin, (..., 3 M, 6)."""
    arms = -skew(points)
    columns = np.concatenate([np.broadcast_to(np.eye(3), arms.shape), arms], axis=-1)
    return columns.reshape((*points.shape[:-2], -1, 6))


def orientable(markers: Array, seen: Mask) -> Mask:
    """Whether the visible markers of a pose span a plane, shape (m,)."""
    weight = seen.astype(float)[..., None]
    count = np.maximum(weight.sum(axis=1, keepdims=True), 1)
    mean = (weight * markers).sum(axis=1, keepdims=True) / count
    spread = np.linalg.svd((markers - mean) * weight, compute_uv=False)
    if spread.shape[-1] < 2:
        return np.zeros(len(seen), dtype=bool)
    return np.asarray((seen.sum(axis=1) >= 3) & (spread[:, 1] > _COLLINEAR * spread[:, 0]))


def pose_from_points(
    points: Array, origin: Array, seen: Mask, weights: Array | None = None
) -> Array:
    """Least-squares pose change for changes of the points, shape (..., m, 6, 3 M).

    points : ndarray, shape (..., m, M, 3), m; origin : ndarray, shape (..., m, 3), m
    weights : ndarray, shape (m, M, 3, 3), 1/m, whitening matrices; equal weights without
    Rows: translation of the origin [m/m], then rotation vector [rad/m], in the axes of the points.
    """
    A = rigid_motions(points - origin[..., None, :]).reshape((*points.shape, 6))
    counted = A * seen[..., None, None]
    if weights is not None:
        counted = np.swapaxes(weights, -1, -2) @ (weights @ counted)
    weighted = np.swapaxes(counted.reshape((*A.shape[:-3], -1, 6)), -1, -2)
    idle = np.logical_not(seen.any(axis=-1, keepdims=True))[..., None] * np.eye(6)
    normal = weighted @ A.reshape((*A.shape[:-3], -1, 6)) + idle
    return np.asarray(np.linalg.solve(normal, weighted))


def free_components(model: Model) -> Mask:
    """Components of the markers that are parameters of the model, shape (M, 3)."""
    return np.asarray(model.marker_columns.any(axis=-1))


def with_measured_shape(model: Model, data: Measurements, values: Array) -> Array:
    """The values with marker positions whose distances are taken from the readings alone, (..., p).

    data : its points (..., m, M, 3) may carry leading axes
    The shape is laid over the given markers, which are a guess; components that are no parameters
    stay as given.
    """
    markers, free = model.marker_positions(values), free_components(model)
    usable = orientable(markers, data.seen)
    points, seen = data.points[..., usable, :, :], data.seen[usable]
    shape = np.broadcast_to(markers, (*points.shape[:-3], *markers.shape))
    for _ in range(_ROUNDS):
        T = fit_rigid(points, shape[..., None, :, :], seen.astype(float))
        marked = transformed(T[..., None, :, :], shape[..., None, :, :])
        rest = ((points - marked) * seen[..., None]).reshape((*T.shape[:-2], -1))
        step = rotate(shape_response(T, shape, seen), rest).sum(axis=-2)
        shape = shape + step.reshape(shape.shape)
        if np.abs(step).max(initial=0.0) < _SETTLED_M:
            break
    offsets = _laid(shape, markers, free) - model.markers
    placed = np.broadcast_to(values, (*offsets.shape[:-2], len(values))).copy()
    tools = model.where(Tool)
    placed[..., tools] = np.einsum("...mi,mip->...p", offsets, model.marker_columns[..., tools])
    return placed


def _laid(shape: Array, markers: Array, free: Mask) -> Array:
    """The shape moved onto the markers, and then so that what is not free coincides."""
    T = fit_rigid(np.broadcast_to(markers, shape.shape), shape)
    laid = transformed(T[..., None, :, :], shape)
    for _ in range(_ROUNDS if not free.all() else 0):
        off = (laid - markers)[..., ~free]
        if np.abs(off).max(initial=0.0) < _SETTLED_M:
            break
        move = rotate(_back(markers, free), off)
        laid = rotate(so3_exp(move[..., 3:])[..., None, :, :], laid) + move[..., None, :3]
    return laid


def _back(shape: Array, free: Mask) -> Array:
    """Smallest rigid motion that takes changes of the components that are not free back, (6, c)."""
    return np.asarray(-np.linalg.pinv(rigid_motions(shape)[~free.reshape(-1)], rcond=1e-9))


def shape_response(T: Array, shape: Array, seen: Mask) -> Array:
    """How the shape follows the points of each pose to first order, (..., m, 3 M, 3 M), m/m.

    T : ndarray, shape (..., m, 4, 4), poses; shape : ndarray, shape (..., M, 3), m, tip axes
    seen : ndarray of bool, shape (m, M), the markers that enter
    Rows are in tip axes, columns in the axes of the points. What a pose adds to the shape is the part
    of its points that no rigid motion explains; of the sum the rigid motions are left out.
    """
    m, M = seen.shape
    batch = shape.shape[:-2]
    spread = np.broadcast_to(shape[..., None, :, :], (*batch, m, M, 3))
    L = pose_from_points(spread, np.zeros((m, 3)), seen)
    mask = np.repeat(seen, 3, axis=1).astype(float)
    own = mask[:, :, None] * (np.eye(3 * M) - rigid_motions(shape)[..., None, :, :] @ L)
    own = own * mask[:, None, :]
    total = np.linalg.pinv(own.sum(axis=-3), rcond=1e-9, hermitian=True)
    response = (total[..., None, :, :] @ own).reshape((*batch, m, 3 * M, M, 3))
    turned = response @ np.swapaxes(T[..., None, :3, :3], -1, -2)
    return np.asarray(turned.reshape((*batch, m, 3 * M, 3 * M)))


def kept_in_place(shape: Array, free: Mask) -> Array:
    """What becomes of a change of the shape once components that are not free are back, (3 M, 3 M)."""
    fixed = ~free.reshape(-1)
    change = np.eye(3 * len(shape))
    if fixed.any():
        change[:, fixed] += rigid_motions(shape) @ _back(shape, free)
    return change
