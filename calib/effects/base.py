"""Placement of the robot base in the frame of the readings, one for each station."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from calib.arm.se3 import rotate, skew, so3_exp, so3_right_jacobian
from calib.arrays import Array
from calib.effects.protocol import Context, Effect, Parameter


@dataclass(frozen=True, eq=False)
class Base(Effect):
    """``T_station_base`` = [exp(rx, ry, rz) | x, y, z], from zero: the frames coincide."""

    station: int
    kind: ClassVar[str] = "base"

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        return context.stations if len(context.stations) > 1 else ("base",)

    @classmethod
    def at(cls, context: Context, where: str) -> Self:
        return cls(where, cls.places(context).index(where))

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        shift = [Parameter(self.kind, self.where, c, "mm", 1e-3, 1e-2) for c in "xyz"]
        turn = [Parameter(self.kind, self.where, f"r{c}", "mrad", 1e-3, 1e-2) for c in "xyz"]
        return (*shift, *turn)

    @staticmethod
    def placement(values: Array) -> tuple[Array, Array]:
        """R_station_base (..., 3, 3) and p_station_base (..., 3), m, of values (..., 6)."""
        return so3_exp(values[..., 3:]), values[..., :3]

    @staticmethod
    def columns(values: Array, points: Array) -> Array:
        """D reading / d parameter of points (..., m, M, 3) in base axes -> (..., m, M, 3, 6)."""
        R, _ = Base.placement(values)
        turn = -R[..., None, None, :, :] @ skew(points)
        turn = turn @ so3_right_jacobian(values[..., 3:])[..., None, None, :, :]
        shift = np.broadcast_to(np.eye(3), turn.shape)
        return np.concatenate([shift, turn], axis=-1)


def to_station(R: Array, p: Array, points: Array) -> Array:
    """Points (..., m, M, 3) from base axes into the frames of their stations (..., m, 3, 3)."""
    return rotate(R[..., None, :, :], points) + p[..., None, :]
