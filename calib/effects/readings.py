"""Kinds of effects on what is read: a marker, a reading, or an instrument's part is displaced."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from calib.arm.se3 import displaced_shape, moved_as_one, so3_exp
from calib.arrays import Array
from calib.effects.context import Context, Expectation
from calib.effects.protocol import DirectedEffect, Effect, Unknown
from calib.effects.tool_base import MARKER
from calib.instruments import Instrument
from calib.instruments.protocol import MOTION, SCALE
from calib.poses import Poses

_PRINTED = 5.0  # odds: printers scale by some tenths of a per cent, castings hardly do


@dataclass(frozen=True, eq=False)
class MarkerEffect(DirectedEffect):
    """Displaces one marker, ``where``, along the axes of the tip frame."""

    @property
    def direction_count(self) -> int:
        return 3

    def marker(self, names: Sequence[str]) -> slice:
        """The marker among those of a model; none where that looks at other points."""
        name = self.where.removeprefix(MARKER)
        at = list(names).index(name) if name in names else 0
        return slice(at, at + (name in names))


@dataclass(frozen=True, eq=False)
class ReadingEffect(Effect):
    """The instrument reads a point elsewhere than it is.

    of : kind of the instruments whose rows it changes
    first : whether it changes rows as the cell's instrument reads them, before other effects do
    """

    of: ClassVar[str] = "points"
    first: ClassVar[bool] = False

    def changes(self, instrument: Instrument) -> bool:
        """Whether it changes the rows of an instrument."""
        return instrument.kind == self.of

    @property
    def depends_on(self) -> str:
        if self.uses:
            return super().depends_on
        return "range" if self.of == "points" else "none"

    @abstractmethod
    def linearise(self, values: Array, poses: Poses, points: Array) -> tuple[Array, Array, Array]:
        """Readings of what is read right as rows (..., m, M, r): points in the axes of their stations.

        values : ndarray, shape (..., p), SI
        Returns readings (..., m, M, r), their derivatives by those rows (..., m or 1, M or 1, r, r) and
        by the parameters (..., m, M, r, p).
        """

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        return ("instrument",) if context.reads(cls.of) else ()

    @classmethod
    def at(cls, context: Context, where: str) -> Effect:
        return cls(where)


@dataclass(frozen=True, eq=False)
class TrackerScale(ReadingEffect):
    """Wrong length scale of the instrument, for example by a wrong air temperature or pressure.

    Every reading is ``(1 + scale)`` times the point, seen from the origin of its station. Free link
    lengths, base and markers imitate it wholly: it shows only where lengths are known.
    """

    kind: ClassVar[str] = "tracker_scale"
    unknowns: ClassVar[tuple[Unknown, ...]] = (("scale", "ppm", 1e-5),)

    def linearise(self, values: Array, poses: Poses, points: Array) -> tuple[Array, Array, Array]:
        grown = 1.0 + values[..., None, None, :]
        turn = grown[..., None] * np.eye(points.shape[-1])
        return grown * points, turn, points[..., None]


@dataclass(frozen=True, eq=False)
class RigidReading(ReadingEffect, DirectedEffect):
    """Moves all readings of a pose as one body, along and about the axes of their station."""

    @property
    def direction_count(self) -> int:
        return 6

    def linearise(self, values: Array, poses: Poses, points: Array) -> tuple[Array, Array, Array]:
        readings, R, rigid = moved_as_one(self.amounts(poses, values), points)
        return readings, R, rigid @ self.response(poses, values)[..., None, :, :]


@dataclass(frozen=True, eq=False)
class PartEffect(DirectedEffect):
    """Displaces a part, ``where``: an instrument, a board, a socket, from its fitted place.

    A camera sees everything displaced along and about its own axes. A board in the world moves and
    grows along its own, about its origin, on the tip along the tip's, about its middle. A socket moves
    along those of the base. What a 6-D instrument reads moves along and about its own axes; what a
    wire or a gauge reads grows by its zero.

    numbers : slice, those of the part that it moves: a zero, three of a shift, six of a motion, or what
        it grows by
    body : slice or None, the markers on the tip that the part is
    """

    numbers: slice
    body: slice | None

    @property
    def direction_count(self) -> int:
        return int(self.numbers.stop - self.numbers.start)

    def site(self, instrument: Instrument) -> str | None:
        """At which of an instrument's sites it acts, None for all."""
        name = self.where.partition(":")[2]
        return name if name in instrument.sites else None

    def moved(self, poses: Poses, values: Array, markers: Array) -> tuple[Array, Array]:
        """Its markers (..., m, k, 3), m, tip frame, displaced about their middle.

        Returns derivatives (..., m, k, 3, p) by its parameters, too.
        """
        by = self._by(poses, values)
        middle = markers.mean(axis=-2, keepdims=True)
        placed, columns = displaced_shape(by, markers - middle)
        columns = columns[..., self.numbers] @ self.response(poses, values)[..., None, :, :]
        return middle + placed, columns

    def carried(self, poses: Poses, values: Array, before: Array) -> Array:
        """How what moves the markers where it acts not, ``before`` (..., m, k, 3, q), moves them here.

        All are in tip axes.
        """
        by = self._by(poses, values)
        A = so3_exp(by[..., MOTION][..., 3:]) * (1.0 + by[..., SCALE])[..., None]
        middle = before.mean(axis=-3, keepdims=True)
        return np.asarray(middle + A[..., None, :, :] @ (before - middle))

    def _by(self, poses: Poses, values: Array) -> Array:
        by = np.zeros((*values.shape[:-1], len(poses), SCALE.stop))
        by[..., self.numbers] = self.amounts(poses, values)
        return by


@dataclass(frozen=True, eq=False)
class BoardScale(PartEffect):
    """Wrong pitch of a board, for example scaled by a printer or measured with a poor ruler.

    All points of a board lie ``(1 + scale)`` times as far apart as the cell says. Where a board alone
    gives the scale of a free geometry, that imitates it wholly.
    """

    kind: ClassVar[str] = "board_scale"
    unknowns: ClassVar[tuple[Unknown, ...]] = (("scale", "ppm", 1e-3, 5e-2),)

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        return tuple(w for w, part in context.parts.items() if part.board is not None)

    @classmethod
    def at(cls, context: Context, where: str) -> Self:
        return cls(where, SCALE, context.parts[where].body)

    @classmethod
    def expected(cls, context: Context, where: str) -> Expectation:
        return Expectation(odds=_PRINTED)

    def response(self, poses: Poses, values: Array) -> Array:
        return np.ones((len(poses), 1, 1))
