"""Slow motion of the robot's base, for example on a floor that settles: zero at the first pose."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from calib.effects.context import Context
from calib.effects.drift import DriftingEffect
from calib.effects.protocol import FrameEffect


@dataclass(frozen=True, eq=False)
class BaseDrift(DriftingEffect, FrameEffect):
    """The base frame moves at constant rates along and about its own axes."""

    kind: ClassVar[str] = "base_drift"

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        return ("base",)

    @classmethod
    def at(cls, context: Context, where: str) -> Self:
        return cls(where=where, frame=0, directions=np.eye(6), clock=context.clock_unit)
