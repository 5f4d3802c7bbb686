"""A socket in which the ball sits wrongly: dirt, a worn rim, another ball.

An offset that is constant in the base's axes only moves the socket, so it is no error. This
effect is an offset that is constant in the tip's axes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from calib.arrays import Array
from calib.effects.context import Context
from calib.effects.protocol import Parameter
from calib.effects.readings import PartEffect
from calib.poses import Poses


@dataclass(frozen=True, eq=False)
class SocketSeat(PartEffect):
    """Markers lie off in the tip frame at the poses at which they sit in the socket.

    sites : tuple of str, sockets of its instrument; with one alone it is the marker's own position
    """

    sites: tuple[str, ...]
    kind: ClassVar[str] = "socket_seat"

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        return tuple(f"socket:{site}" for i in context.instruments for site in i.sites)

    @classmethod
    def at(cls, context: Context, where: str) -> Self:
        name = where.partition(":")[2]
        sites = next(i.sites for i in context.instruments if name in i.sites)
        return cls(where, slice(0, 3), slice(0, len(context.single_markers)), sites)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return tuple(Parameter(self.kind, self.where, c, "um", 1e-6, 1e-4, 5e-3) for c in "xyz")

    def response(self, poses: Poses, values: Array) -> Array:
        here = poses.touching(self.where.partition(":")[2], self.sites).astype(float)
        return here[:, None, None] * np.eye(3)
