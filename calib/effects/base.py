"""Position and orientation of each instrument, and of each station, relative to the robot base."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

from calib.arrays import Array
from calib.effects.context import Context
from calib.effects.protocol import Effect, Parameter
from calib.instruments import TRACKER, Instrument


@dataclass(frozen=True, eq=False)
class Base(Effect):
    """The place of an instrument; at first where the cell says that it stands, or at zero.

    station : int or None, the station where it stands so; None for one that never moves, or that has
        sites: it stands so at the one of its name
    """

    station: int | None
    of: Instrument = TRACKER
    kind: ClassVar[str] = "base"
    lasting: ClassVar[bool] = False

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        return tuple(base.where for base in _standing(context))

    @classmethod
    def at(cls, context: Context, where: str) -> Self:
        found = next(base for base in _standing(context) if base.where == where)
        return cls(where, found.station, found.of)

    @property
    def initial(self) -> Array:
        return self.of.guess_at(self.where)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return tuple(Parameter(self.kind, self.where, *own) for own in self.of.unknowns)

    @property
    def believed(self) -> Array:
        return self.of.prior

    @property
    def belief(self) -> Array:
        return self.of.belief


def sought(context: Context) -> tuple[Base, ...]:
    """Places that are unknown even where the model has no base."""
    return tuple(base for base in _standing(context) if base.of.sought)


def _standing(context: Context) -> list[Base]:
    """Every place: that of the tracker by its station, others by their names."""
    stations = context.stations if len(context.stations) > 1 else ("base",)
    found: list[Base] = []
    for instrument in context.instruments:
        if not instrument.unknowns:
            continue
        if not instrument.has_stations:
            found += [Base(name, None, instrument) for name in instrument.names]
            continue
        first = not any(base.of.has_stations for base in found)
        before = "" if first else f"{instrument.name}:"
        found += [Base(f"{before}{name}", i, instrument) for i, name in enumerate(stations)]
    return found
