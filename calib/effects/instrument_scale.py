"""Wrong length scale of a tracker."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from calib.arrays import Array
from calib.effects.protocol import Parameter
from calib.effects.readings import ReadingEffect
from calib.poses import Poses


@dataclass(frozen=True, eq=False)
class TrackerScale(ReadingEffect):
    """Wrong length scale of the instrument, for example by a wrong air temperature or pressure.

    Every reading is ``(1 + scale)`` times the point, seen from the origin of its station. Free link
    lengths, base and markers imitate it wholly: it shows only where lengths are known.
    """

    kind: ClassVar[str] = "tracker_scale"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter(self.kind, self.where, "scale", "ppm", 1e-6, 1e-5),)

    def linearise(self, values: Array, poses: Poses, points: Array) -> tuple[Array, Array, Array]:
        grown = 1.0 + values[..., None, None, :]
        turn = grown[..., None] * np.eye(points.shape[-1])
        return grown * points, turn, points[..., None]
