"""Errors of a joint's transmission that follow the angles as read: ratio, gear and coupling."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from calib.arm.robot import Robot
from calib.arrays import Array
from calib.effects.context import Context, Expectation, joint_index, needs
from calib.effects.drive import DriveError, along_axis, error_unit, variable_unit
from calib.effects.protocol import Parameter
from calib.poses import Poses

# Odds of a ratio that is not as designed: screws and belts stretch, teeth are counted.
_TURNING = 0.2


@dataclass(frozen=True, eq=False)
class TransmissionScale(DriveError):
    """Wrong gear ratio or encoder scale: ``dq = scale * q``, q as read."""

    kind: ClassVar[str] = "transmission_scale"

    @classmethod
    def expected(cls, context: Context, where: str) -> Expectation:
        slides = context.robot.prismatic[joint_index(context, where)]
        return Expectation(odds=1.0 if slides else _TURNING)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        unit = f"{error_unit(self.slides)}/{variable_unit(self.slides)}"
        return (Parameter(self.kind, self.where, "scale", unit, 1e-6, 1e-4),)

    def shares(self, poses: Poses) -> Array:
        return poses.q[:, self.frame - 1, None]


@dataclass(frozen=True, eq=False)
class TransmissionHarmonic(DriveError):
    """Gear errors that repeat with the joint's turn: eccentricity (once) and ovality (twice).

    ``dq = cos_1 cos q + sin_1 sin q + cos_2 cos 2q + sin_2 sin 2q``, q as read. Data sheets of strain
    wave gears state 1 to 1.5 arc minutes from peak to peak: 150 to 220 urad.
    """

    kind: ClassVar[str] = "transmission_harmonic"
    turns: ClassVar[bool] = True

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        names = ("cos_1", "sin_1", "cos_2", "sin_2")
        return tuple(Parameter(self.kind, self.where, n, "urad", 1e-6, 2e-4) for n in names)

    def shares(self, poses: Poses) -> Array:
        q = poses.q[:, self.frame - 1]
        return np.column_stack([np.cos(q), np.sin(q), np.cos(2 * q), np.sin(2 * q)])


@dataclass(frozen=True, eq=False)
class JointCoupling(DriveError):
    """Joints that move another joint, as the hollow shafts of a wrist do: ``dq = from_j * q_j``.

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
        """Positions of the joints that move it."""
        return self.robot.moved_by(self.frame - 1)

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
