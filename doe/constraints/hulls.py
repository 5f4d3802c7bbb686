"""Distances to the convex hull of a mesh, as MuJoCo computes them (extra ``sim``).

What is far is told by the ball about the hull: at most the distance, which is enough to prove that a
motion is free.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from threading import Lock
from typing import Any

import numpy as np

from calib.arrays import Array
from calib.cell.planned import Hull
from calib.errors import CalibError
from doe.constraints.distances import point_segment

_NEAR = 0.2  # m beyond what is asked for: from there on the ball will do
_ROUNDING = 1e-5  # m, of MuJoCo's distances
_THIN = 1e-6  # m, radius of a segment


@dataclass(frozen=True, eq=False)
class HullDistances:
    """Distances of segments to a hull; hull : Hull."""

    hull: Hull
    _lock: Lock = field(default_factory=Lock)

    def from_segment(self, start: Array, end: Array, wanted: float | Array = 0.0) -> Array:
        """Distance of segments (..., 3), shape (...), m; at most that where it is far above ``wanted``.

        Zero where they meet. Raises CalibError where MuJoCo is not installed.
        """
        start, end = np.broadcast_arrays(start, end)
        centre, radius = self.hull.ball
        found = np.maximum(point_segment(centre, start, end) - radius, 0.0)
        near = found <= np.asarray(wanted) + _NEAR
        found[near] = self._exact(start[near], end[near])
        return found

    def _exact(self, start: Array, end: Array) -> Array:
        """Distance of segments (n, 3), shape (n,), m."""
        mujoco, model, data = self._model
        along = end - start
        half = 0.5 * np.linalg.norm(along, axis=1)
        turns, middle = _along_z(along, half), 0.5 * (start + end)
        found, apart = np.empty(len(start)), np.zeros(6)
        with self._lock:  # one arm at a time stands in the model
            for i in range(len(start)):
                model.geom_size[1, 1], model.geom_rbound[1] = half[i], half[i] + _THIN
                data.geom_xpos[1], data.geom_xmat[1] = middle[i], turns[i]
                found[i] = mujoco.mj_geomDistance(model, data, 0, 1, 1e3, apart)
        return np.maximum(found + _THIN - _ROUNDING, 0.0)

    @cached_property
    def _model(self) -> tuple[Any, Any, Any]:
        """MuJoCo, a model of the hull and a thin capsule, and its data."""
        try:
            import mujoco
        except ImportError:
            raise CalibError(
                "obstacles of type mesh need MuJoCo, which is not installed; "
                "pip install 'posecal[sim]', or give boxes"
            ) from None
        spec = mujoco.MjSpec()
        spec.add_mesh(name="hull", uservert=self.hull.points.ravel())
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="hull")
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=[_THIN, 1.0, 0.0])
        model = spec.compile()
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        return mujoco, model, data


@lru_cache(maxsize=64)
def distances_to(hull: Hull) -> HullDistances:
    """The same for each that asks, so that MuJoCo takes a hull in once."""
    return HullDistances(hull)


def _along_z(vectors: Array, half: Array) -> Array:
    """Rotations, shape (n, 9), that turn z to vectors (n, 3); any for those of no length."""
    z = np.where(
        half[:, None] > 0.0, vectors / np.maximum(2.0 * half, 1e-300)[:, None], [0.0, 0.0, 1.0]
    )
    other = np.eye(3)[np.abs(z).argmin(axis=1)]
    x = np.cross(other, z)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return np.stack([x, np.cross(z, x), z], axis=-1).reshape(-1, 9)
