"""Rigid motion that grows with the session's clock: what both drifts share."""

from __future__ import annotations

import numpy as np

from calib.arm.se3 import rotate, skew, so3_exp, so3_right_jacobian
from calib.arrays import Array
from calib.effects.protocol import Parameter
from calib.poses import Poses

_HOUR = 3600.0  # s
_READINGS_AN_HOUR = 100.0  # of a plausible session


def drift_parameters(kind: str, where: str, clock: str) -> tuple[Parameter, ...]:
    """Three velocities and three turn rates, SI per second or per reading.

    clock : str, unit of the session's clock (:attr:`calib.poses.Poses.clock_unit`)
    """
    timed = clock == "s"
    per, one = ("h", _HOUR) if timed else (clock, 1.0)
    hour = _HOUR if timed else _READINGS_AN_HOUR
    scale, size, largest = 1e-6 / one, 1e-4 / hour, 5e-3 / hour
    shift = [Parameter(kind, where, c, f"um/{per}", scale, size, largest) for c in "xyz"]
    turn = [Parameter(kind, where, f"r{c}", f"urad/{per}", scale, size, largest) for c in "xyz"]
    return (*shift, *turn)


def since_the_first(poses: Poses, clock: str) -> Array:
    """What the clock shows since the session's first reading, shape (m,); zero where it is silent."""
    read = poses.clock_in(clock)
    return np.zeros(len(poses)) if read is None else read


def moved_as_one(xi: Array, points: Array) -> tuple[Array, Array, Array]:
    """Points (..., m, M, 3), m, displaced by a twist xi (..., m, 6), m and rad, of each pose.

    Returns them, the rotations (..., m, 1, 3, 3), and derivatives by the twist (..., m, M, 3, 6).
    """
    xi = xi[..., None, :]  # one for all markers of a pose
    R = so3_exp(xi[..., 3:])
    turn = -R @ skew(points) @ so3_right_jacobian(xi[..., 3:])
    columns = np.concatenate([np.broadcast_to(np.eye(3), turn.shape), turn], axis=-1)
    return rotate(R, points) + xi[..., :3], R, columns
