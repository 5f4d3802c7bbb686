"""Motion while the arm, its base or the instrument warms up: ``amplitude exp(-t / tau)``.

The time t starts at the first reading of the session. The motion falls to zero; a pose without a
time is taken as warm. Arms take half an hour to three hours (Appl. Sci. 11(22) 10813).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from calib.arrays import Array
from calib.effects.context import Context
from calib.effects.protocol import FrameEffect, Parameter
from calib.effects.readings import RigidReading
from calib.effects.timed import SECONDS, Timed, everything, function_of
from calib.effects.tuned import ANY_TUNING
from calib.poses import Poses

_SHORTEST, _LONGEST, _STEPS = 0.02, 2.0, 10  # of the session
_AT_ONCE = 1e-9  # s or readings: shorter is zero, and the sign of a time constant says nothing


@dataclass(frozen=True, eq=False)
class WarmUp(Timed):
    """The exponential, wherever it acts."""

    kind: ClassVar[str] = "warm_up"
    size: ClassVar[float] = 1e-4  # m or rad: tenths of a millimetre
    largest: ClassVar[float] = 5e-3

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        return everything(context)

    @property
    def tuning_parameter(self) -> Parameter:
        timed = self.clock == SECONDS
        unit, scale, size = ("min", 60.0, 600.0) if timed else ("readings", 1.0, 10.0)
        return Parameter(self.kind, self.where, "tau", unit, scale, size, ANY_TUNING)

    def functions(self, poses: Poses, tuning: Array) -> Array:
        return self._falling(poses, np.asarray(tuning))[0]

    def slopes(self, poses: Poses, tuning: Array) -> Array:
        return self._falling(poses, np.asarray(tuning))[1]

    def _falling(self, poses: Poses, tuning: Array) -> tuple[Array, Array]:
        t = poses.clock_in(self.clock)
        if t is None:
            rest = function_of(np.zeros(len(poses)), tuning, poses)
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
