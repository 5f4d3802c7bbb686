"""Rigid motion that grows with time, in an hour's units: what both drifts share."""

from __future__ import annotations

from calib.effects.protocol import Parameter
from calib.poses import Poses
from calib.se3 import Array

_HOUR = 3600.0  # s


def drift_parameters(kind: str, where: str) -> tuple[Parameter, ...]:
    """Three velocities and three turn rates, SI per second."""
    scale, size, largest = 1e-6 / _HOUR, 1e-4 / _HOUR, 5e-3 / _HOUR
    shift = [Parameter(kind, where, c, "um/h", scale, size, largest) for c in "xyz"]
    turn = [Parameter(kind, where, f"r{c}", "urad/h", scale, size, largest) for c in "xyz"]
    return (*shift, *turn)


def drifted(values: Array, poses: Poses) -> Array:
    """Displacement since the first pose of the session, shape (..., m, 6), m and rad."""
    return poses.elapsed[:, None] * values[..., None, :]
