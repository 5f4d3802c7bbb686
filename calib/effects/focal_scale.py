"""Wrong focal length: an old calibration, a lens that was refocused, or a scaled image."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from calib.arrays import Array
from calib.effects.focal import FocalEffect
from calib.effects.protocol import Parameter
from calib.instruments import Camera
from calib.instruments.lens import FOCAL
from calib.poses import Poses


@dataclass(frozen=True, eq=False)
class FocalScale(FocalEffect):
    """Both focal lengths are ``(1 + scale)`` times those that the cell holds for known."""

    kind: ClassVar[str] = "focal_scale"

    @classmethod
    def acts(cls, camera: Camera) -> bool:
        return bool((camera.free >= FOCAL.stop).all())

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter(self.kind, self.where, "scale", "ppm", 1e-6, 1e-3, 5e-2),)

    def shares(self, poses: Poses) -> Array:
        return np.ones(len(poses))
