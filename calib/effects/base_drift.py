"""Slow motion of the robot's base, for example on a floor that settles: zero at the first pose."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from calib.effects.drift import drift_parameters, since_the_first
from calib.effects.protocol import Context, Parameter, PoseEffect, Twist
from calib.poses import Poses


@dataclass(frozen=True, eq=False)
class BaseDrift(PoseEffect):
    """The base frame moves at constant rates along and about its own axes.

    clock : str, unit of the session's clock
    """

    clock: str
    kind: ClassVar[str] = "base_drift"
    uses: ClassVar[tuple[str, ...]] = ("time",)

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        return ("base",)

    @classmethod
    def at(cls, context: Context, where: str) -> Self:
        return cls(where, context.clock_unit)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return drift_parameters(self.kind, self.where, self.clock)

    def twists_at(self, poses: Poses) -> tuple[Twist, ...]:
        return ((0, since_the_first(poses, self.clock)[:, None, None] * np.eye(6)),)
