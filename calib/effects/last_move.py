"""Errors that depend on a joint's last move: lost motion, wind-up by friction, settling."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from calib.arrays import Array
from calib.effects.context import Context, Expectation, joint_index
from calib.effects.drive import DriveError, along_axis, error_unit, variable_unit
from calib.effects.protocol import Effect, Parameter, SpringEffect
from calib.effects.usual import light
from calib.poses import Poses

_SERVO = 10.0  # 2 mrad become 20: geared servos have 4 to 6 when new (ROBOTIS, MX-28 and XM430)
# N m or N: small arms wind up by 0.1 N m, large ones by tens, most of it lost in the gear.
_FRICTION, _MOST_FRICTION = 5.0, 500.0
# 0.05 deg of a move of a radian or so was seen.
_MISSING, _MOST_MISSING = 1e-3, 1e-2


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

    @classmethod
    def expected(cls, context: Context, where: str) -> Expectation:
        return Expectation(allowance=_SERVO if light(context) else 1.0)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        unit = error_unit(self.slides)
        return (Parameter(self.kind, self.where, "half_width", unit, 1e-6, 2e-4),)

    def shares(self, poses: Poses) -> Array:
        if poses.approach is None:
            return np.zeros((len(poses), 1))
        return poses.approach[:, self.frame - 1, None]


@dataclass(frozen=True, eq=False)
class FrictionWindup(SpringEffect):
    """Friction of a joint that winds up its elastic drive: ``dq = -compliance torque approach``.

    Friction acts against the last motion, and the joint's compliance makes it visible. The model
    needs a compliance of this joint. With a constant compliance, this effect is observationally
    equivalent to ``backlash``.

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
        return cls(where, joint + 1, robot.frame_count, along_axis(robot, joint))

    @classmethod
    def repeats(cls, where: str, active: Sequence[Effect]) -> str | None:
        here = {effect.kind for effect in active if effect.where == where}
        if "stiffness_vs_angle" in here:
            return None
        return "backlash" if "joint_compliance" in here else ""

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        name, unit = ("force", "N") if self.axis[:3].any() else ("torque", "N m")
        return (Parameter(self.kind, self.where, name, unit, 1.0, _FRICTION, _MOST_FRICTION),)

    def wrench_basis(self, poses: Poses) -> Array:
        basis = np.zeros((len(poses), self.frames, 6, 1))
        if poses.approach is not None:
            basis[:, self.frame, :, 0] = -poses.approach[:, self.frame - 1, None] * self.axis
        return basis


@dataclass(frozen=True, eq=False)
class Settling(DriveError):
    """Readings taken before the arm is at rest: a part of each joint's last move is still missing.

    ``dq = -(per_move move + per_speed move / longest)``. A lag leaves a share of the move itself, or
    of the speed near its end. In a synchronised move this speed is the joint's share of the longest
    move.
    """

    kind: ClassVar[str] = "settling"
    uses: ClassVar[tuple[str, ...]] = ("motion", "approach")

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        unit = error_unit(self.slides)
        named = (("per_move", f"{unit}/{variable_unit(self.slides)}"), ("per_speed", unit))
        return tuple(
            Parameter(self.kind, self.where, name, own, 1e-6, _MISSING, _MOST_MISSING)
            for name, own in named
        )

    def shares(self, poses: Poses) -> Array:
        if poses.motion is None or poses.approach is None:
            return np.zeros((len(poses), 2))
        joint = self.frame - 1
        move = poses.approach[:, joint] * poses.motion[:, joint]
        longest = poses.motion.max(axis=1)
        share = np.divide(move, longest, out=np.zeros(len(poses)), where=longest > 0.0)
        return -np.column_stack([move, share])
