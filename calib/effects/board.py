"""A board that is not as large as the cell says."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from calib.arrays import Array
from calib.effects.context import Context, Expectation
from calib.effects.protocol import Parameter
from calib.effects.readings import PartEffect
from calib.instruments.protocol import SCALE
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
