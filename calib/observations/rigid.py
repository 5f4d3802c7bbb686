"""What a set of markers says of a rigid motion."""

from __future__ import annotations

import numpy as np

from calib.arm.se3 import skew
from calib.arrays import Array, Mask

_COLLINEAR = 1e-3  # ratio of marker spreads below which no orientation can be computed


def rigid_motions(points: Array) -> Array:
    """Changes of points (..., M, 3) by translation and rotation about the origin, (..., 3 M, 6)."""
    arms = -skew(points)
    columns = np.concatenate([np.broadcast_to(np.eye(3), arms.shape), arms], axis=-1)
    return columns.reshape((*points.shape[:-2], -1, 6))


def orientable(markers: Array, seen: Mask) -> Mask:
    """Whether the visible markers of a pose span a plane, shape (m,)."""
    weight = seen.astype(float)[..., None]
    mean = (weight * markers).sum(axis=1, keepdims=True) / np.maximum(
        weight.sum(1, keepdims=True), 1
    )
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
    return np.asarray(
        np.linalg.solve(weighted @ A.reshape((*A.shape[:-3], -1, 6)) + idle, weighted)
    )
