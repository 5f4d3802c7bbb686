"""Zero error of a joint: ``q_true = q_read + offset``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

from calib.effects.protocol import (
    Constant,
    Context,
    Parameter,
    along_axis,
    joint_index,
)
from calib.se3 import Array


@dataclass(frozen=True, eq=False)
class JointOffset(Constant):
    """Constant error of one joint variable."""

    axis: Array
    kind: ClassVar[str] = "joint_offset"

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        return context.robot.joints

    @classmethod
    def at(cls, context: Context, where: str) -> Self:
        joint = joint_index(context, where)
        return cls(where, joint + 1, along_axis(context.robot, joint))

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        unit = "um" if self.axis[:3].any() else "urad"
        return (Parameter(self.kind, self.where, "offset", unit, 1e-6, 1e-3),)

    @property
    def columns(self) -> Array:
        return self.axis[:, None]
