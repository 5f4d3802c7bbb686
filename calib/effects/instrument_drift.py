"""Drift of an instrument: a tripod that settles, a gauge that warms up, a wire that creeps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

from calib.effects.context import Context, motion_of
from calib.effects.drift import DriftingEffect, drift_rate
from calib.effects.protocol import Parameter
from calib.effects.readings import PartEffect


@dataclass(frozen=True, eq=False)
class InstrumentDrift(DriftingEffect, PartEffect):
    """A part of an instrument moves at constant rates from where it stood at the first pose in time.

    A gauge and a wire have one rate, that of their zero. A tracker's is ``tracker_drift``.
    """

    kind: ClassVar[str] = "instrument_drift"

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        own = (i for i in context.instruments if not i.sites)  # one with sites moves at each alone
        return tuple(w for i in own if (w := f"{i.kind}:{i.name}") in i.parts)

    @classmethod
    def at(cls, context: Context, where: str) -> Self:
        part = context.parts[where]
        return cls(where, motion_of(part), part.body, context.clock_unit)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        if self.numbers.stop == 1:
            return (drift_rate(self.kind, self.where, "zero", "um", self.clock),)
        return super().parameters
