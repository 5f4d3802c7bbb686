"""The outer factors of the product: places of instruments, and of markers and bodies on the tip."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import ClassVar, Self

import numpy as np

from calib.arm.se3 import fit_rigid, rotate, skew, so3_exp, so3_log, so3_right_jacobian
from calib.arrays import Array
from calib.effects.context import Context
from calib.effects.geometry import Geometry
from calib.effects.protocol import Effect, Parameter
from calib.instruments import TRACKER, Instrument

_BODY = "body:"
MARKER = "marker:"


@dataclass(frozen=True, eq=False)
class Base(Effect):
    """The place of an instrument, at first where the cell says that it stands, or at zero.

    station : int or None, the station of that place; None for an instrument that never moves, or that
        has sites and stands so at the one of its name
    """

    station: int | None
    of: Instrument = TRACKER
    kind: ClassVar[str] = "base"

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        return tuple(base.where for base in _standing(context))

    @classmethod
    def at(cls, context: Context, where: str) -> Self:
        base = next(base for base in _standing(context) if base.where == where)
        return cls(where, base.station, base.of)

    @property
    def initial(self) -> Array:
        return self.of.guess_at(self.where)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return tuple(Parameter(self.kind, self.where, *unknown) for unknown in self.of.unknowns)


def sought(context: Context) -> tuple[Base, ...]:
    """Places that are unknown even where the model has no base."""
    return tuple(base for base in _standing(context) if base.of.sought)


def _standing(context: Context) -> list[Base]:
    """Every place: that of the tracker by its station, others by their names."""
    stations = context.stations if len(context.stations) > 1 else ("base",)
    bases: list[Base] = []
    for instrument in context.instruments:
        if not instrument.unknowns:
            continue
        if not instrument.has_stations:
            bases += [Base(name, None, instrument) for name in instrument.names]
            continue
        first = not any(base.of.has_stations for base in bases)
        before = "" if first else f"{instrument.name}:"
        bases += [Base(f"{before}{name}", i, instrument) for i, name in enumerate(stations)]
    return bases


@dataclass(frozen=True, eq=False)
class Tool(Effect):
    """Corrections of one marker's position in the tip frame, from the cell's first guess."""

    marker: int
    components: tuple[int, ...] = (0, 1, 2)
    kind: ClassVar[str] = "tool"

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        alone = (f"{MARKER}{name}" for name in context.single_markers)
        return (*alone, *(f"{_BODY}{name}" for name in context.bodies))

    @classmethod
    def at(cls, context: Context, where: str) -> Tool:
        if where.startswith(_BODY):
            points = context.bodies[where.removeprefix(_BODY)]
            return Body(where, points.start, guess=context.markers[points])
        return cls(where, context.marker_names.index(where.removeprefix(MARKER)))

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return tuple(
            self.parameter(Geometry.names[c], "mm" if c < 3 else "mrad", 1e-2)
            for c in self.components
        )

    @property
    def markers(self) -> slice:
        """Positions of the markers that it moves, k of them."""
        return slice(self.marker, self.marker + 1)

    def offsets(self, values: Array) -> Array:
        """By how much they move, shape (..., k, 3), m, tip axes."""
        return self._whole(values)[..., None, :3]

    def columns(self, values: Array) -> Array:
        """The derivative of that, shape (..., k, 3, p)."""
        return np.eye(3)[None, :, list(self.components)]

    def values_at(self, offsets: Array) -> Array:
        """The values (p,) that move its markers by (k, 3), m, as far as they can."""
        return np.asarray(offsets[0, list(self.components)])

    def only(self, kept: tuple[int, ...]) -> Self:
        """The same with some of its parameters, by their positions."""
        return replace(self, components=tuple(self.components[i] for i in kept))

    def _whole(self, values: Array) -> Array:
        xi = np.zeros((*values.shape[:-1], 6))
        xi[..., list(self.components)] = values
        return xi


@dataclass(frozen=True, eq=False)
class Body(Tool):
    """Where a body sits on the tip: first point and rotation vector, in tip axes, from the guess.

    marker : position of its first point among the markers; the others follow
    guess : ndarray, shape (k, 3), m, these points: of a frame, its origin and the ends of two axes
    """

    components: tuple[int, ...] = (0, 1, 2, 3, 4, 5)
    guess: Array = field(default_factory=lambda: np.zeros((3, 3)))

    @property
    def markers(self) -> slice:
        return slice(self.marker, self.marker + len(self.guess))

    @property
    def _arms(self) -> Array:
        return np.asarray(self.guess - self.guess[0])

    def offsets(self, values: Array) -> Array:
        xi = self._whole(values)
        turned = rotate(so3_exp(xi[..., 3:])[..., None, :, :], self._arms)
        return turned - self._arms + xi[..., None, :3]

    def columns(self, values: Array) -> Array:
        r = self._whole(values)[..., 3:]
        turn = -(so3_exp(r)[..., None, :, :] @ skew(self._arms))
        turn = turn @ so3_right_jacobian(r)[..., None, :, :]
        whole = np.concatenate([np.broadcast_to(np.eye(3), turn.shape), turn], axis=-1)
        return np.asarray(whole[..., list(self.components)])

    def values_at(self, offsets: Array) -> Array:
        T = fit_rigid(self._arms + offsets, self._arms)
        return np.concatenate([offsets[0], so3_log(T[:3, :3])])[list(self.components)]
