"""The shape of the marker set, when nothing is known of it but the readings.

Approach #1 needs it before it can compute a pose, and takes it from the same readings: the mean
congruent shape (generalised Procrustes). Its error is common to all poses.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calib.effects.tool import Tool
from calib.model import Model
from calib.observations.rigid import orientable, pose_from_points, rigid_motions
from calib.poses import Measurements
from calib.se3 import Array, fit_rigid, inverse, rotate

_ROUNDS = 300
_SETTLED_M = 1e-10


def with_measured_shape(model: Model, data: Measurements, values: Array) -> Array:
    """The values with marker positions whose distances are taken from the readings alone, (..., p).

    data : its points (..., m, M, 3) may carry leading axes
    The shape is laid over the given markers, which are a guess.
    """
    markers = model.marker_positions(values)
    usable = orientable(markers, data.seen)
    points, seen = data.points[..., usable, :, :], data.seen[usable].astype(float)
    count = seen.sum(axis=0)[:, None]
    shape = np.broadcast_to(markers, (*points.shape[:-3], *markers.shape))
    for _ in range(_ROUNDS):
        T = inverse(fit_rigid(points, shape[..., None, :, :], seen))
        own = rotate(T[..., None, :3, :3], points) + T[..., None, :3, 3]
        mean = (own * seen[..., None]).sum(axis=-3) / np.maximum(count, 1.0)
        before, shape = shape, np.where(count > 0.0, mean, shape)
        if np.abs(shape - before).max() < _SETTLED_M:
            break
    T = fit_rigid(np.broadcast_to(markers, shape.shape), shape)
    offsets = rotate(T[..., None, :3, :3], shape) + T[..., None, :3, 3] - model.markers
    placed = np.broadcast_to(values, (*offsets.shape[:-2], len(values))).copy()
    for effect, part in zip(model.effects, model.slices, strict=True):
        if isinstance(effect, Tool):
            placed[..., part] = offsets[..., effect.marker, list(effect.components)]
    return placed


def shape_response(T: Array, shape: Array, seen: NDArray[np.bool_]) -> Array:
    """How the mean shape follows the points of each pose to first order, (m, 3 M, 3 M), m/m.

    T : ndarray, shape (m, 4, 4), poses; shape : ndarray, shape (M, 3), m, tip axes
    seen : ndarray of bool, shape (m, M), the markers that enter
    Rows are in tip axes, columns in the axes of the points. What a pose adds to the shape is the part
    of its points that no rigid motion explains; of the sum the rigid motions are left out.
    """
    m, M = seen.shape
    motions = np.broadcast_to(shape, (m, M, 3))
    L = pose_from_points(motions, np.zeros((m, 3)), seen)
    arms = rigid_motions(shape)
    mask = np.repeat(seen, 3, axis=1).astype(float)
    own = mask[:, :, None] * (np.eye(3 * M) - arms @ L) * mask[:, None, :]
    response = np.linalg.pinv(own.sum(axis=0), rcond=1e-9, hermitian=True) @ own
    turned = response.reshape(m, 3 * M, M, 3) @ np.swapaxes(T[:, None, :3, :3], -1, -2)
    return np.asarray(turned.reshape(m, 3 * M, 3 * M))
