"""Focal length that drifts during the session, from its value at the first pose."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

from calib.arrays import Array
from calib.effects.context import Context
from calib.effects.drift import drift_rate, since_the_first
from calib.effects.focal import FocalEffect
from calib.effects.protocol import Parameter
from calib.instruments import Camera
from calib.instruments.lens import CENTER
from calib.poses import Poses


@dataclass(frozen=True, eq=False)
class FocalDrift(FocalEffect):
    """Both focal lengths grow at a constant rate.

    clock : str, unit of the session's clock
    """

    clock: str
    kind: ClassVar[str] = "focal_drift"
    uses: ClassVar[tuple[str, ...]] = ("time",)

    @classmethod
    def made(cls, context: Context, where: str, camera: Camera) -> Self:
        return cls(where, camera.lens.values[CENTER], context.clock_unit)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (drift_rate(self.kind, self.where, "rate", "ppm", self.clock),)

    def shares(self, poses: Poses) -> Array:
        return since_the_first(poses, self.clock)
