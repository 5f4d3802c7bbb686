"""What grows with the session's clock: rates that all drifts share, and motions at such rates."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from calib.arrays import Array
from calib.effects.protocol import DirectedEffect, Parameter
from calib.poses import Poses

_HOUR = 3600.0  # s
_READINGS_AN_HOUR = 100.0  # of a plausible session


@dataclass(frozen=True, eq=False)
class DriftingEffect(DirectedEffect):
    """Motion at constant rates from the first pose in time.

    clock : str, unit of the session's clock (:attr:`calib.poses.Poses.clock_unit`)
    """

    clock: str
    uses: ClassVar[tuple[str, ...]] = ("time",)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Rates, SI per second or per reading."""
        shift = [(c, "um") for c in "xyz"]
        turn = [(f"r{c}", "urad") for c in "xyz"]
        return tuple(drift_rate(self.kind, self.where, *own, self.clock) for own in (*shift, *turn))

    def response(self, poses: Poses, values: Array) -> Array:
        elapsed = since_the_first(poses, self.clock)
        return elapsed[:, None, None] * np.eye(len(self.parameters))


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
