"""Slow motion of the instrument: a tripod that settles or warms up, zero at the first pose."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

from calib.effects.context import Context
from calib.effects.drift import DriftingEffect
from calib.effects.readings import RigidReading


@dataclass(frozen=True, eq=False)
class TrackerDrift(DriftingEffect, RigidReading):
    """Readings move as one body at constant rates along and about the axes of their station."""

    kind: ClassVar[str] = "tracker_drift"

    @classmethod
    def at(cls, context: Context, where: str) -> Self:
        return cls(where, context.clock_unit)
