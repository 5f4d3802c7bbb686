"""Rigid motion that grows with the session's clock: what both drifts share."""

from __future__ import annotations

import numpy as np

from calib.arrays import Array
from calib.effects.protocol import Parameter
from calib.poses import Poses

_HOUR = 3600.0  # s
_READINGS_AN_HOUR = 100.0  # of a plausible session


def drift_parameters(kind: str, where: str, clock: str) -> tuple[Parameter, ...]:
    """Three velocities and three turn rates, SI per second or per reading.

    clock : str, unit of the session's clock (:attr:`calib.poses.Poses.clock_unit`)
    """
    shift = [drift_rate(kind, where, c, "um", clock) for c in "xyz"]
    turn = [drift_rate(kind, where, f"r{c}", "urad", clock) for c in "xyz"]
    return (*shift, *turn)


def drift_rate(kind: str, where: str, name: str, unit: str, clock: str) -> Parameter:
    """One rate, in millionths of the SI unit."""
    timed = clock == "s"
    per, one = ("h", _HOUR) if timed else (clock, 1.0)
    hour = _HOUR if timed else _READINGS_AN_HOUR
    return Parameter(kind, where, name, f"{unit}/{per}", 1e-6 / one, 1e-4 / hour, 5e-3 / hour)


def since_the_first(poses: Poses, clock: str) -> Array:
    """What the clock shows since the session's first reading, shape (m,); zero where it is silent."""
    read = poses.clock_in(clock)
    return np.zeros(len(poses)) if read is None else read
