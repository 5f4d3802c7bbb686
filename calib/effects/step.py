"""Sudden changes at one moment: of joints, base, instruments, boards or markers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from calib.arrays import Array
from calib.effects.context import Context
from calib.effects.protocol import FrameEffect, Parameter
from calib.effects.readings import MarkerEffect, PartEffect, RigidReading
from calib.effects.timed import (
    SECONDS,
    Timed,
    everything,
    function_of,
    markers,
)
from calib.effects.tuned import ANY_TUNING
from calib.poses import Poses

_EITHER_SIDE = 2  # readings: fewer are an outlier


@dataclass(frozen=True, eq=False)
class Step(Timed):
    """A sudden change at one moment: a knock, a belt that slipped, a new mastering, a moved marker.

    All readings after the moment are displaced, none before it. A pose without a time is taken as
    later. The data cannot tell when between two readings the change happened.
    """

    kind: ClassVar[str] = "step"
    smooth: ClassVar[bool] = False
    size: ClassVar[float] = 1e-4  # m or rad
    largest: ClassVar[float] = 1e-2

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        return (*everything(context), *markers(context), *context.parts)

    @property
    def tuning_parameter(self) -> Parameter:
        timed = self.clock == SECONDS
        unit, size = ("s", 60.0) if timed else ("readings", 1.0)
        return Parameter(self.kind, self.where, "at", unit, 1.0, size, ANY_TUNING)

    def functions(self, poses: Poses, tuning: Array) -> Array:
        t = poses.clock_in(self.clock)
        if t is None:
            return function_of(np.ones(len(poses)), tuning, poses)
        after = t > np.asarray(tuning)[..., None]
        return after[..., None].astype(float)

    def slopes(self, poses: Poses, tuning: Array) -> Array:
        return function_of(np.zeros(len(poses)), tuning, poses)

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
