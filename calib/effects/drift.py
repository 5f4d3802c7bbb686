"""Slow motion at constant rates, zero at the first pose: of base, tracker, or another instrument."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from calib.arrays import Array
from calib.effects.context import Context, motion_of
from calib.effects.protocol import DirectedEffect, FrameEffect, Parameter
from calib.effects.readings import PartEffect, RigidReading
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


@dataclass(frozen=True, eq=False)
class InstrumentDrift(DriftingEffect, PartEffect):
    """Drift of an instrument: a tripod that settles, a gauge that warms up, a wire that creeps.

    A gauge and a wire have one rate, that of their zero. A tracker's is ``tracker_drift``.
    """

    kind: ClassVar[str] = "instrument_drift"

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        own = (i for i in context.instruments if not i.sites)  # one with sites moves at each alone
        return tuple(w for i in own if (w := f"{i.kind}:{i.name}") in i.parts)

    @classmethod
    def at(cls, context: Context, where: str) -> Self:
        part = context.parts[where]
        return cls(where, motion_of(part), part.body, context.clock_unit)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        if self.numbers.stop == 1:
            return (drift_rate(self.kind, self.where, "zero", "um", self.clock),)
        return super().parameters
