"""Elastic pedestal: the base tilts under the overturning moment."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from calib.arrays import Array
from calib.effects.bearing_compliance import tilt_across
from calib.effects.protocol import Context, ElasticEffect, Expected, Parameter
from calib.effects.usual import softer
from calib.poses import Poses

# rad/(N m): a robot on a table or a light pedestal has up to 10, one on a telescopic column 15 to 25
# (base of the Hilti construction robot on five kinds of ground)
_LARGEST = 3e-5


@dataclass(frozen=True, eq=False)
class BaseCompliance(ElasticEffect):
    """Tilt about the horizontal directions of the base frame (across its z axis)."""

    kind: ClassVar[str] = "base_compliance"

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        return ("base",)

    @classmethod
    def at(cls, context: Context, where: str) -> Self:
        return cls(where, 0)

    @classmethod
    def expected(cls, context: Context, where: str) -> Expected:
        return Expected(allowance=softer(context))

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter(self.kind, self.where, "tilt", "urad/(N m)", 1e-6, 1e-7, _LARGEST),)

    def flexibility(self, poses: Poses) -> Array:
        return tilt_across(np.array([0.0, 0.0, 1.0]))
