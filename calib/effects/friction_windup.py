"""Friction of a joint that winds up its elastic drive: ``dq = -compliance torque approach``.

Friction acts against the last motion, and the joint's compliance makes it visible. The model
needs a compliance of this joint. With a constant compliance, this effect is observationally
equivalent to ``backlash``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from calib.arrays import Array
from calib.effects.context import Context, joint_index
from calib.effects.drive import along_axis
from calib.effects.protocol import Effect, Parameter, SpringEffect
from calib.poses import Poses

# N m or N: small arms wind up by 0.1 N m, large ones by tens, most of it lost in the gear.
_SIZE, _LARGEST = 5.0, 500.0


@dataclass(frozen=True, eq=False)
class FrictionWindup(SpringEffect):
    """Friction torque at one joint, added to what its drive carries.

    frame : int, the joint's; frames : int, of the arm
    axis : ndarray, shape (6,), unit wrench along the joint's variable
    """

    frame: int
    frames: int
    axis: Array
    kind: ClassVar[str] = "friction_windup"
    uses: ClassVar[tuple[str, ...]] = ("approach",)

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        return context.robot.joints

    @classmethod
    def at(cls, context: Context, where: str) -> Self:
        joint, robot = joint_index(context, where), context.robot
        return cls(where, joint + 1, robot.dof + 2, along_axis(robot, joint))

    @classmethod
    def repeats(cls, where: str, active: Sequence[Effect]) -> str | None:
        here = {effect.kind for effect in active if effect.where == where}
        if "stiffness_vs_angle" in here:
            return None
        return "backlash" if "joint_compliance" in here else ""

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        name, unit = ("force", "N") if self.axis[:3].any() else ("torque", "N m")
        return (Parameter(self.kind, self.where, name, unit, 1.0, _SIZE, _LARGEST),)

    def wrench_basis(self, poses: Poses) -> Array:
        basis = np.zeros((len(poses), self.frames, 6, 1))
        if poses.approach is not None:
            basis[:, self.frame, :, 0] = -poses.approach[:, self.frame - 1, None] * self.axis
        return basis
