"""Slow motion of the instrument: a tripod that settles or warms up, zero at the first pose."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

from calib.arm.se3 import moved_as_one
from calib.arrays import Array
from calib.effects.drift import drift_parameters, since_the_first
from calib.effects.protocol import Context, Parameter, ReadingEffect
from calib.poses import Poses


@dataclass(frozen=True, eq=False)
class TrackerDrift(ReadingEffect):
    """Readings move as one body at constant rates along and about the axes of their station.

    clock : str, unit of the session's clock
    """

    clock: str
    kind: ClassVar[str] = "tracker_drift"
    uses: ClassVar[tuple[str, ...]] = ("time",)

    @classmethod
    def at(cls, context: Context, where: str) -> Self:
        return cls(where, context.clock_unit)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return drift_parameters(self.kind, self.where, self.clock)

    def linearise(self, values: Array, poses: Poses, points: Array) -> tuple[Array, Array, Array]:
        elapsed = since_the_first(poses, self.clock)
        readings, R, columns = moved_as_one(elapsed[:, None] * values[..., None, :], points)
        return readings, R, elapsed[:, None, None, None] * columns
