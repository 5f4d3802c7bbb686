"""Wrong gear ratio, or scale of an encoder: ``dq = scale * q``, q as read."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from calib.arrays import Array
from calib.effects.drive import DriveError, error_unit, variable_unit
from calib.effects.protocol import Parameter
from calib.poses import Poses


@dataclass(frozen=True, eq=False)
class TransmissionScale(DriveError):
    """An error of one joint's variable in proportion to it."""

    kind: ClassVar[str] = "transmission_scale"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        unit = f"{error_unit(self.slides)}/{variable_unit(self.slides)}"
        return (Parameter(self.kind, self.where, "scale", unit, 1e-6, 1e-4),)

    def shares(self, poses: Poses) -> Array:
        return poses.q[:, self.frame - 1, None]
