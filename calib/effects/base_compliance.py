"""Elastic pedestal: the base tilts under the overturning moment."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from calib.arrays import Array
from calib.effects.bearing_compliance import tilt_across
from calib.effects.protocol import Context, ElasticEffect, Parameter
from calib.poses import Poses

_LARGEST = 1e-5  # rad/(N m): a robot on a table or a light pedestal


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

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter(self.kind, self.where, "tilt", "urad/(N m)", 1e-6, 1e-7, _LARGEST),)

    def flexibility(self, poses: Poses) -> Array:
        return tilt_across(np.array([0.0, 0.0, 1.0]))
