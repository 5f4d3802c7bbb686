"""Slow motion at constant rates, zero at the first pose: of base or tracker."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from calib.arrays import Array
from calib.effects.context import Context
from calib.effects.protocol import DirectedEffect, FrameEffect, Parameter
from calib.effects.readings import RigidReading
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
    lasting: ClassVar[bool] = False

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Rates, SI per second or per reading."""
        timed = self.clock == "s"
        per, one = ("h", _HOUR) if timed else (self.clock, 1.0)
        hour = _HOUR if timed else _READINGS_AN_HOUR
        shift = [(c, "um") for c in "xyz"]
        turn = [(f"r{c}", "urad") for c in "xyz"]
        return tuple(
            Parameter(self.kind, self.where, n, f"{u}/{per}", 1e-6 / one, 1e-4 / hour, 5e-3 / hour)
            for n, u in (*shift, *turn)
        )

    def response(self, poses: Poses, values: Array) -> Array:
        read = poses.clock_in(self.clock)
        elapsed = np.zeros(len(poses)) if read is None else read  # of a clock that is silent
        return elapsed[:, None, None] * np.eye(6)


@dataclass(frozen=True, eq=False)
class BaseDrift(DriftingEffect, FrameEffect):
    """Slow motion of the robot's base, for example on a floor that settles: zero at the first pose."""

    kind: ClassVar[str] = "base_drift"

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        return ("base",)

    @classmethod
    def at(cls, context: Context, where: str) -> Self:
        return cls(where=where, frame=0, directions=np.eye(6), clock=context.clock_unit)


@dataclass(frozen=True, eq=False)
class TrackerDrift(DriftingEffect, RigidReading):
    """Slow motion of the instrument: a tripod that settles or warms up, zero at the first pose.

    Readings move as one body along and about the axes of their station.
    """

    kind: ClassVar[str] = "tracker_drift"

    @classmethod
    def at(cls, context: Context, where: str) -> Self:
        return cls(where, context.clock_unit)
