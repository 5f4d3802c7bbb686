"""Wrong length scale of the instrument, for example by a wrong air temperature or pressure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from calib.effects.protocol import Parameter
from calib.effects.readings import ScaledReading


@dataclass(frozen=True, eq=False)
class TrackerScale(ScaledReading):
    """Every reading is ``(1 + scale)`` times the point, seen from the origin of its station.

    Free link lengths, base and markers imitate it wholly: it shows only where lengths are known.
    """

    kind: ClassVar[str] = "tracker_scale"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter(self.kind, self.where, "scale", "ppm", 1e-6, 1e-5),)
