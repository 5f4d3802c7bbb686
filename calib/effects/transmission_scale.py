"""Wrong gear ratio or encoder scale: ``dq = scale * q``, q as read."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from calib.arrays import Array
from calib.effects.context import Context, Expectation
from calib.effects.drive import DriveError, error_unit, variable_unit
from calib.effects.protocol import Parameter
from calib.poses import Poses

_TURNING = (
    0.2  # odds of a ratio that is not as designed: screws and belts stretch, teeth are counted
)


@dataclass(frozen=True, eq=False)
class TransmissionScale(DriveError):
    """An error of one joint's variable in proportion to it."""

    kind: ClassVar[str] = "transmission_scale"

    @classmethod
    def expected(cls, context: Context, where: str) -> Expectation:
        slides = context.robot.prismatic[context.robot.joints.index(where)]
        return Expectation(odds=1.0 if slides else _TURNING)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        unit = f"{error_unit(self.slides)}/{variable_unit(self.slides)}"
        return (Parameter(self.kind, self.where, "scale", unit, 1e-6, 1e-4),)

    def shares(self, poses: Poses) -> Array:
        return poses.q[:, self.frame - 1, None]
