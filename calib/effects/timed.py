"""Effects that follow the session's clock: a drift, a warm-up, a step.

A warm-up is ``amplitude exp(-t / tau)``. The time t starts at the first reading of the session. The
motion falls to zero; a pose without a time is taken as warm. Arms take half an hour to three hours
(Appl. Sci. 11(22) 10813).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from calib.arrays import Array
from calib.effects.context import Context, joint_index, motion_of
from calib.effects.geometry import Geometry
from calib.effects.joint import along_axis, error_unit
from calib.effects.protocol import DirectedEffect, Effect, FrameEffect, Parameter
from calib.effects.readings import MarkerEffect, PartEffect, RigidReading
from calib.effects.tool_base import MARKER
from calib.effects.tuned import ANY_TUNING, Tuned
from calib.poses import Poses

SECONDS = "s"
_HOUR = 3600.0  # s: where the search for a tuning begins
_READINGS_AN_HOUR = 100.0  # of a plausible session
_UNITS = ("um",) * 3 + ("urad",) * 3
_SHORTEST, _LONGEST, _STEPS = 0.02, 2.0, 10  # of the session
_AT_ONCE = 1e-9  # s or readings: shorter is zero, and the sign of a time constant says nothing
_EITHER_SIDE = 2  # readings: fewer are an outlier


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
        per, hour = ("h", _HOUR) if self.clock == SECONDS else (self.clock, _READINGS_AN_HOUR)
        return tuple(
            self.parameter(name, f"{unit}/{per}", 1e-4 / hour, 5e-3 / hour)
            for name, unit in zip(Geometry.names, _UNITS, strict=True)
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


@dataclass(frozen=True, eq=False)
class Timed(Tuned):
    """One function of the clock, times what its place can do; a subclass of it for each kind of place.

    clock : str, unit of the session's clock (:attr:`calib.poses.Poses.clock_unit`)
    units : tuple of str, unit of the error in each direction
    """

    clock: str
    units: tuple[str, ...]
    uses: ClassVar[tuple[str, ...]] = ("time",)
    size: ClassVar[float] = 1e-4  # m or rad
    largest: ClassVar[float]

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        """Base, instrument and every joint: what heat moves."""
        read = ("instrument",) if context.reads("points") else ()
        return ("base", *read, *context.robot.joints)

    @classmethod
    def at(cls, context: Context, where: str) -> Effect:
        slot, directions = _placement(context, where)
        kind = next(kind for kind in cls.__subclasses__() if issubclass(kind, slot))
        tuning = _HOUR if context.clock_unit == SECONDS else _READINGS_AN_HOUR
        return kind(where=where, tuning=tuning, clock=context.clock_unit, **directions)

    @property
    def amplitudes(self) -> tuple[Parameter, ...]:
        names = ("offset",) if len(self.units) == 1 else Geometry.names
        return tuple(
            self.parameter(name, unit, self.size, self.largest)
            for name, unit in zip(names, self.units, strict=False)
        )


def _placement(context: Context, where: str) -> tuple[type[Effect], Mapping[str, Any]]:
    """What moves at a place, and its directions as the fields of a timed effect there."""
    robot = context.robot
    part = context.parts.get(where)
    if part is not None:
        numbers = motion_of(part)
        return PartEffect, {"units": _UNITS[numbers], "numbers": numbers, "body": part.body}
    if where == "instrument":
        return RigidReading, {"units": _UNITS}
    if where.startswith(MARKER):
        return MarkerEffect, {"units": _UNITS[:3]}
    if where == "base":
        return FrameEffect, {"units": _UNITS, "frame": 0, "directions": np.eye(6)}
    joint = joint_index(context, where)
    unit = error_unit(bool(robot.prismatic[joint]))
    along = along_axis(robot, joint)[:, None]
    return FrameEffect, {"units": (unit,), "frame": joint + 1, "directions": along}


def _function(values: Array, tuning: Array, poses: Poses) -> Array:
    """One function's values, shape (..., m, 1), in the shape of the tunings (...)."""
    return np.broadcast_to(values, (*np.shape(tuning), len(poses)))[..., None]


@dataclass(frozen=True, eq=False)
class WarmUp(Timed):
    """The exponential, wherever it acts."""

    kind: ClassVar[str] = "warm_up"
    largest: ClassVar[float] = 5e-3

    @property
    def tuning_parameter(self) -> Parameter:
        unit, size = ("min", 600.0) if self.clock == SECONDS else ("readings", 10.0)
        return self.parameter("tau", unit, size, ANY_TUNING)

    def functions(self, poses: Poses, tuning: Array) -> Array:
        return self._falling(poses, np.asarray(tuning))[0]

    def slopes(self, poses: Poses, tuning: Array) -> Array:
        return self._falling(poses, np.asarray(tuning))[1]

    def _falling(self, poses: Poses, tuning: Array) -> tuple[Array, Array]:
        t = poses.clock_in(self.clock)
        if t is None:
            rest = _function(np.zeros(len(poses)), tuning, poses)
            return rest, rest
        tau = np.maximum(np.abs(tuning), _AT_ONCE)[..., None, None]
        left = np.exp(-t[:, None] / tau)
        return left, np.sign(tuning)[..., None, None] * left * (t[:, None] / tau) / tau

    def grid(self, poses: Poses) -> Array:
        t = poses.clock_in(self.clock)
        session = 0.0 if t is None or not len(t) else float(np.ptp(t))
        if session == 0.0:
            return np.zeros(0)
        return np.geomspace(_SHORTEST * session, _LONGEST * session, _STEPS)


@dataclass(frozen=True, eq=False)
class WarmUpOfFrame(WarmUp, FrameEffect):
    """Warm-up of the base, or of a joint's zero."""


@dataclass(frozen=True, eq=False)
class WarmUpOfReadings(WarmUp, RigidReading):
    """Warm-up of the instrument."""


@dataclass(frozen=True, eq=False)
class Step(Timed):
    """A sudden change at one moment: a knock, a belt that slipped, a new mastering, a moved marker.

    All readings after the moment are displaced, none before it. A pose without a time is taken as
    later. The data cannot say when between two readings the change happened.
    """

    kind: ClassVar[str] = "step"
    smooth: ClassVar[bool] = False
    largest: ClassVar[float] = 1e-2

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        markers = (MARKER + name for name in context.single_markers)
        return (*super().places(context), *markers, *context.parts)

    @property
    def tuning_parameter(self) -> Parameter:
        unit, size = (SECONDS, 60.0) if self.clock == SECONDS else ("readings", 1.0)
        return self.parameter("at", unit, size, ANY_TUNING)

    def functions(self, poses: Poses, tuning: Array) -> Array:
        t = poses.clock_in(self.clock)
        if t is None:
            return _function(np.ones(len(poses)), tuning, poses)
        after = t > np.asarray(tuning)[..., None]
        return after[..., None].astype(float)

    def slopes(self, poses: Poses, tuning: Array) -> Array:
        return _function(np.zeros(len(poses)), tuning, poses)

    def grid(self, poses: Poses) -> Array:
        t = poses.clock_in(self.clock)
        if t is None:
            return np.zeros(0)
        read, count = np.unique(t, return_counts=True)
        before = np.cumsum(count)[:-1]
        apart = (before >= _EITHER_SIDE) & (len(t) - before >= _EITHER_SIDE)
        return np.asarray((0.5 * (read[1:] + read[:-1]))[apart])


@dataclass(frozen=True, eq=False)
class StepOfFrame(Step, FrameEffect):
    """A step of the base, or of a joint's zero."""


@dataclass(frozen=True, eq=False)
class StepOfReadings(Step, RigidReading):
    """A step of the instrument."""


@dataclass(frozen=True, eq=False)
class StepOfMarker(Step, MarkerEffect):
    """A step of one marker in the tip frame."""


@dataclass(frozen=True, eq=False)
class StepOfPart(Step, PartEffect):
    """A step of an instrument, a board or a socket.

    A camera moves along and about its own axes, whether it stands or rides on the hand.
    """
