"""Wrong length scale of an instrument: of a tracker, or of a wire or bar."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from calib.effects.context import Context
from calib.effects.protocol import Parameter
from calib.effects.readings import ScaledReading
from calib.instruments import Distance, Instrument


@dataclass(frozen=True, eq=False)
class TrackerScale(ScaledReading):
    """Wrong length scale of the instrument, for example by a wrong air temperature or pressure.

    Every reading is ``(1 + scale)`` times the point, seen from the origin of its station. Free link
    lengths, base and markers imitate it wholly: it shows only where lengths are known.
    """

    kind: ClassVar[str] = "tracker_scale"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter(self.kind, self.where, "scale", "ppm", 1e-6, 1e-5),)


@dataclass(frozen=True, eq=False)
class WireScale(ScaledReading):
    """Wrong scale of a wire or bar: a wrong drum radius, a wrong encoder pitch, a bar too warm.

    Every distance is ``(1 + scale)`` times what it would be. Where such an instrument alone gives the
    scale of a free geometry, that imitates it wholly.
    """

    kind: ClassVar[str] = "wire_scale"
    of: ClassVar[str] = Distance.kind

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        return tuple(f"{cls.of}:{i.name}" for i in context.instruments if i.kind == cls.of)

    def changes(self, instrument: Instrument) -> bool:
        return self.where == f"{instrument.kind}:{instrument.name}"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter(self.kind, self.where, "scale", "ppm", 1e-6, 1e-4, 2e-2),)
