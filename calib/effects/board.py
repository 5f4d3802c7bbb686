"""A board that is not as the cell says: of another size, or bent."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from calib.arrays import Array
from calib.effects.context import Context, Expectation
from calib.effects.protocol import Parameter
from calib.effects.readings import PartEffect
from calib.instruments.detection import Board
from calib.instruments.protocol import BEND, SCALE
from calib.poses import Poses

_PRINTED = 5.0  # odds: printers scale by some tenths of a per cent, castings hardly do


@dataclass(frozen=True, eq=False)
class BoardScale(PartEffect):
    """Wrong pitch of a board, for example scaled by a printer or measured with a poor ruler.

    All points of a board lie ``(1 + scale)`` times as far apart as the cell says. Where a board alone
    gives the scale of a free geometry, that imitates it wholly.
    """

    kind: ClassVar[str] = "board_scale"
    decided_by: ClassVar[str] = (
        "measure the board with a caliper, or add one known length ([[known_distances]])"
    )

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        return tuple(w for w, part in context.parts.items() if part.board is not None)

    @classmethod
    def at(cls, context: Context, where: str) -> Self:
        return cls(where, SCALE, context.parts[where].body)

    @classmethod
    def expected(cls, context: Context, where: str) -> Expectation:
        return Expectation(odds=_PRINTED)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter(self.kind, self.where, "scale", "ppm", 1e-6, 1e-3, 5e-2),)

    def response(self, poses: Poses, values: Array) -> Array:
        return np.ones((len(poses), 1, 1))


@dataclass(frozen=True, eq=False)
class BoardBend(PartEffect):
    """A flat board that is bent: printed on card, clamped at one edge, or bowed by heat and damp.

    Its middle stands out of the plane of its edges, along its z axis, by
    ``z = x_sag (1 - u^2) + y_sag (1 - v^2) + twist u v`` with u and v from -1 to 1 over the board.
    This is every curvature that is the same all over it. That its edges come nearer is of second order.
    """

    board: Board
    kind: ClassVar[str] = "board_bend"

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        return tuple(w for w, part in context.parts.items() if part.numbers == BEND.stop)

    @classmethod
    def at(cls, context: Context, where: str) -> Self:
        part = context.parts[where]
        if part.board is None:
            raise KeyError(where)
        return cls(where, BEND, part.body, part.board)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        names = ("x_sag", "y_sag", "twist")
        return tuple(Parameter(self.kind, self.where, n, "mm", 1e-3, 3e-4, 1e-2) for n in names)

    def response(self, poses: Poses, values: Array) -> Array:
        return np.broadcast_to(np.eye(3), (len(poses), 3, 3))

    def moved(self, poses: Poses, values: Array, markers: Array) -> tuple[Array, Array]:
        x, y = np.moveaxis(self.board.axes(markers), -2, 0)
        out, bulges = np.cross(x, y)[..., None, :], self.board.bulges
        moved = markers + (bulges @ values[..., None, :, None]) * out
        return moved, bulges[:, None, :] * out[..., None]

    def carried(self, poses: Poses, values: Array, markers: Array, before: Array) -> Array:
        x, y = np.moveaxis(self.board.axes(markers), -2, 0)
        by = np.moveaxis(before, -1, -3)  # (..., m, q, k, 3)
        by_x, by_y = np.moveaxis(self.board.axes(by), -2, 0)
        turned = np.cross(by_x, y[..., None, :]) + np.cross(x[..., None, :], by_y)
        by = by + (self.board.bulges @ values[..., None, None, :, None]) * turned[..., None, :]
        return np.moveaxis(by, -3, -1)
