"""Errors along the variable of one joint: zero, gear, coupling, and what the last move leaves behind.

``q_true = q_read + dq``. Each class states dq.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from calib.arm.robot import Robot
from calib.arrays import Array
from calib.effects.context import Context, Expectation, joint_index, light, needs, turning_joints
from calib.effects.protocol import (
    Constant,
    Effect,
    Parameter,
    PoseEffect,
    Twist,
    Unknown,
)
from calib.poses import Poses

_SERVO = 10.0  # 2 mrad become 20: geared servos have 4 to 6 when new (ROBOTIS, MX-28 and XM430)
_TURNING = (
    0.2  # odds of a ratio that is not as designed: screws and belts stretch, teeth are counted
)
_MISSING, _MOST_MISSING = 1e-3, 1e-2  # 0.05 deg of a move of a radian or so was seen
_SENSED = 5e-4  # rad/(N m): joints with torque sensors yield by 30 to 100 urad/(N m)


def along_axis(robot: Robot, joint: int) -> Array:
    """Unit displacement along a joint's variable, shape (6,)."""
    part = slice(0, 3) if robot.prismatic[joint] else slice(3, 6)
    unit = np.zeros(6)
    unit[part] = robot.axes[joint]
    return unit


def error_unit(prismatic: bool) -> str:
    """Unit of an error of a joint's variable."""
    return "um" if prismatic else "urad"


def variable_unit(prismatic: bool) -> str:
    """SI unit of a joint's variable, the denominator of errors in proportion to it."""
    return "m" if prismatic else "rad"


def compliance_unit(prismatic: bool) -> tuple[str, float]:
    """Unit of a joint's compliance, and a plausible size.

    Heavy arms have 0.3 to 5 urad/(N m); strain wave gears of the smallest wrists (sizes 11 to 17) some
    1e4 down to 3e3 N m/rad by their makers' tables: 100 to 300 urad/(N m), ten times this.
    """
    return ("nm/N", 1e-6) if prismatic else ("urad/(N m)", 3e-5)


@dataclass(frozen=True, eq=False)
class OnJoint(Effect):
    """Acts along the variable of one joint.

    frame : int, the joint's
    axis : ndarray, shape (6,), unit displacement, or wrench, along the joint's variable
    turns : whether its places are joints that turn, not slide
    """

    frame: int
    axis: Array
    turns: ClassVar[bool] = False

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        return turning_joints(context) if cls.turns else context.robot.joints

    @classmethod
    def at(cls, context: Context, where: str) -> Self:
        joint = joint_index(context, where)
        return cls(where, joint + 1, along_axis(context.robot, joint))

    @property
    def slides(self) -> bool:
        """Whether the joint is prismatic."""
        return bool(self.axis[:3].any())

    def parameter(
        self, name: str, unit: str, size: float, largest: float | None = None
    ) -> Parameter:
        """The same. In a unit ``dq`` stands for that of the variable's error, ``q`` for its own."""
        units = {"dq": error_unit(self.slides), "q": variable_unit(self.slides)}
        shown = "/".join(units.get(part, part) for part in unit.split("/"))
        return super().parameter(name, shown, size, largest)


@dataclass(frozen=True, eq=False)
class JointOffset(OnJoint, Constant):
    """Zero error of a joint: ``q_true = q_read + offset``."""

    kind: ClassVar[str] = "joint_offset"
    unknowns: ClassVar[tuple[Unknown, ...]] = (("offset", "dq", 1e-3),)

    @property
    def columns(self) -> Array:
        return self.axis[:, None]


@dataclass(frozen=True, eq=False)
class DriveError(OnJoint, PoseEffect):
    """An error of a joint's variable: ``dq = shares @ parameters``."""

    @abstractmethod
    def shares(self, poses: Poses) -> Array:
        """D dq / d parameter at each pose, shape (m, p), SI."""

    def twists_at(self, poses: Poses, values: Array) -> tuple[Twist, ...]:
        return ((self.frame, self.axis[:, None] * self.shares(poses)[:, None, :]),)

    def of_joint(self, each: Array | None, poses: Poses) -> Array:
        """What poses hold of every joint (m, n), of this one, shape (m, 1); zero where they do not."""
        return np.zeros((len(poses), 1)) if each is None else each[:, self.frame - 1, None]


@dataclass(frozen=True, eq=False)
class TransmissionScale(DriveError):
    """Wrong gear ratio or encoder scale: ``dq = scale * q``, q as read."""

    kind: ClassVar[str] = "transmission_scale"
    unknowns: ClassVar[tuple[Unknown, ...]] = (("scale", "dq/q", 1e-4),)

    @classmethod
    def expected(cls, context: Context, where: str) -> Expectation:
        slides = context.robot.prismatic[joint_index(context, where)]
        return Expectation(odds=1.0 if slides else _TURNING)

    def shares(self, poses: Poses) -> Array:
        return self.of_joint(poses.q, poses)


@dataclass(frozen=True, eq=False)
class TransmissionHarmonic(DriveError):
    """Gear errors that repeat with the joint's turn: eccentricity (once) and ovality (twice).

    ``dq = cos_1 cos q + sin_1 sin q + cos_2 cos 2q + sin_2 sin 2q``, q as read. Data sheets of strain
    wave gears state 1 to 1.5 arc minutes from peak to peak: 150 to 220 urad.
    """

    kind: ClassVar[str] = "transmission_harmonic"
    turns: ClassVar[bool] = True
    unknowns: ClassVar[tuple[Unknown, ...]] = tuple(
        (name, "urad", 2e-4) for name in ("cos_1", "sin_1", "cos_2", "sin_2")
    )

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
        joints, slides = self.robot.joints, self.robot.prismatic.tolist()
        return tuple(
            self.parameter(f"from_{joints[k]}", f"dq/{variable_unit(slides[k])}", 1e-4)
            for k in self.others
        )

    def driven_by(self, values: Array, poses: Poses) -> str:
        """The joint that moves it most at fitted values (p,), as named in the results."""
        reach = np.abs(values) * np.ptp(self.shares(poses), axis=0)
        return f"q:{self.robot.joints[self.others[int(np.argmax(reach))]]}"

    def shares(self, poses: Poses) -> Array:
        return poses.q[:, self.others]


@dataclass(frozen=True, eq=False)
class Backlash(DriveError):
    """Lost motion of a joint: its position depends on the approach direction.

    ``dq = half_width * approach``. The approach direction is the sign of the joint's last motion, and 0
    where it is unknown. A negative half width is ordinary lost motion: the joint stops before its
    target, because it is read at the motor. A positive half width goes too far, as with a controller
    that compensates too much. A usual value for a robot's gear is one arc minute from side to side,
    290 urad. Worn and small gears have more.
    """

    kind: ClassVar[str] = "backlash"
    uses: ClassVar[tuple[str, ...]] = ("approach",)
    unknowns: ClassVar[tuple[Unknown, ...]] = (("half_width", "dq", 2e-4),)

    @classmethod
    def expected(cls, context: Context, where: str) -> Expectation:
        return Expectation(allowance=_SERVO if light(context) else 1.0)

    def shares(self, poses: Poses) -> Array:
        return self.of_joint(poses.approach, poses)


@dataclass(frozen=True, eq=False)
class Settling(DriveError):
    """Readings taken before the arm is at rest: a part of each joint's last move is still missing.

    ``dq = -(per_move move + per_speed move / longest)``. A lag leaves a share of the move itself, or
    of the speed near its end. In a synchronised move this speed is the joint's share of the longest
    move.
    """

    kind: ClassVar[str] = "settling"
    uses: ClassVar[tuple[str, ...]] = ("motion", "approach")
    unknowns: ClassVar[tuple[Unknown, ...]] = (
        ("per_move", "dq/q", _MISSING, _MOST_MISSING),
        ("per_speed", "dq", _MISSING, _MOST_MISSING),
    )

    def shares(self, poses: Poses) -> Array:
        if poses.motion is None or poses.approach is None:
            return np.zeros((len(poses), 2))
        joint = self.frame - 1
        move = poses.approach[:, joint] * poses.motion[:, joint]
        longest = poses.motion.max(axis=1)
        share = np.divide(move, longest, out=np.zeros(len(poses)), where=longest > 0.0)
        return -np.column_stack([move, share])


@dataclass(frozen=True, eq=False)
class MeasuredTorque(DriveError):
    """Elastic drive under the torque that the arm measured: ``dq = compliance * torque``.

    The torque comes from the columns ``<joint>_Nm``, positive along the joint's motion. A constant
    torque error counts as an error of the joint's zero.
    """

    kind: ClassVar[str] = "measured_torque"
    uses: ClassVar[tuple[str, ...]] = ("torque",)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        largest = None if self.slides else _SENSED
        return (self.parameter("compliance", *compliance_unit(self.slides), largest),)

    def shares(self, poses: Poses) -> Array:
        return self.of_joint(poses.torque, poses)
