"""Focal lengths that are not what the cell states: by a constant share, by time, by temperature.

The share is common to both: an old calibration, a lens that was refocused, or a scaled image.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

from calib.arrays import Array
from calib.effects.context import Context
from calib.effects.drift import drift_rate, since_the_first
from calib.effects.lens import CameraEffect
from calib.effects.protocol import Parameter
from calib.effects.readings import ScaledReading
from calib.instruments import Camera
from calib.instruments.lens import CENTER, FOCAL
from calib.poses import Poses


@dataclass(frozen=True, eq=False)
class FocalEffect(CameraEffect, ScaledReading):
    """The image grows about the principal point.

    lens : ndarray, shape (n,), values of the lens as the cell gives it
    clock : str, unit of the session's clock
    """

    lens: Array
    clock: str

    @classmethod
    def made(cls, context: Context, where: str, camera: Camera) -> Self:
        return cls(where, camera.lens.values, context.clock_unit)

    @property
    def centre(self) -> Array:
        return self.lens[CENTER]


class FocalScale(FocalEffect):
    """Wrong focal length: an old calibration, a lens that was refocused, or a scaled image.

    Both focal lengths are ``(1 + scale)`` times those that the cell holds for known.
    """

    kind: ClassVar[str] = "focal_scale"

    @classmethod
    def acts(cls, camera: Camera) -> bool:
        return bool((camera.free >= FOCAL.stop).all())

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter(self.kind, self.where, "scale", "ppm", 1e-6, 1e-3, 5e-2),)


class FocalDrift(FocalEffect):
    """Focal length that drifts during the session, from its value at the first pose."""

    kind: ClassVar[str] = "focal_drift"
    uses: ClassVar[tuple[str, ...]] = ("time",)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (drift_rate(self.kind, self.where, "rate", "ppm", self.clock),)

    def shares(self, poses: Poses) -> Array:
        return since_the_first(poses, self.clock)


class FocalExpansion(FocalEffect):
    """Focal length that changes with temperature; the cell's value holds at 20 degC.

    Plastic mounts and lenses reach some 1e-4 1/K.
    """

    kind: ClassVar[str] = "focal_expansion"
    uses: ClassVar[tuple[str, ...]] = ("temperature",)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter(self.kind, self.where, "growth", "ppm/K", 1e-6, 2e-5, 1e-3),)

    def shares(self, poses: Poses) -> Array:
        return poses.warming
