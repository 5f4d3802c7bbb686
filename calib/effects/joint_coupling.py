"""Joints that move another joint, as the hollow shafts of a wrist do: ``dq = from_j * q_j``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from calib.arm.robot import Robot
from calib.arrays import Array
from calib.effects.context import Context, joint_index, needs
from calib.effects.drive import DriveError, along_axis, error_unit, variable_unit
from calib.effects.protocol import Parameter
from calib.poses import Poses


@dataclass(frozen=True, eq=False)
class JointCoupling(DriveError):
    """An error of one joint's variable in proportion to every other joint's, as read.

    robot : Robot, whose joint names and kinds the parameters carry
    """

    robot: Robot
    kind: ClassVar[str] = "joint_coupling"

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        return context.robot.joints if context.robot.dof > 1 else ()

    @classmethod
    def at(cls, context: Context, where: str) -> Self:
        joint, robot = joint_index(context, where), context.robot
        reason = "the robot has no other joint"
        needs(robot.dof > 1, f"{cls.kind}:{where}", reason, "take it out of [model] effects")
        return cls(where, joint + 1, along_axis(robot, joint), robot)

    @property
    def others(self) -> list[int]:
        """Positions of the other joints."""
        return [k for k in range(self.robot.dof) if k != self.frame - 1]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        own = error_unit(self.slides)
        return tuple(
            Parameter(
                self.kind,
                self.where,
                f"from_{self.robot.joints[k]}",
                f"{own}/{variable_unit(bool(self.robot.prismatic[k]))}",
                1e-6,
                1e-4,
            )
            for k in self.others
        )

    def driven_by(self, values: Array, poses: Poses) -> str:
        reach = np.abs(values) * np.ptp(self.shares(poses), axis=0)
        return f"q:{self.robot.joints[self.others[int(np.argmax(reach))]]}"

    def shares(self, poses: Poses) -> Array:
        return poses.q[:, self.others]
