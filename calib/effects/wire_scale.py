"""Wrong scale of a wire or bar: a wrong drum radius, a wrong encoder pitch, a bar too warm."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from calib.arrays import Array
from calib.effects.context import Context
from calib.effects.protocol import Parameter
from calib.effects.readings import ReadingEffect
from calib.instruments import Instrument
from calib.poses import Poses

_DISTANCE = "distance"


@dataclass(frozen=True, eq=False)
class WireScale(ReadingEffect):
    """Every distance is ``(1 + scale)`` times what it would be.

    Where such an instrument alone gives the scale of a free geometry, that imitates it wholly.
    """

    kind: ClassVar[str] = "wire_scale"
    of: ClassVar[str] = _DISTANCE

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        own = (i for i in context.instruments if i.kind == _DISTANCE)
        return tuple(f"{_DISTANCE}:{instrument.name}" for instrument in own)

    def changes(self, instrument: Instrument) -> bool:
        return self.where == f"{instrument.kind}:{instrument.name}"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter(self.kind, self.where, "scale", "ppm", 1e-6, 1e-4, 2e-2),)

    def linearise(self, values: Array, poses: Poses, points: Array) -> tuple[Array, Array, Array]:
        factor = 1.0 + values[..., None, None, :]
        return points * factor, factor[..., None] * np.eye(1), points[..., None]
