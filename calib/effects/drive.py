"""Effects along the variable of one joint: errors of its reading, and of its drive."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from calib.arm.robot import Robot
from calib.arrays import Array, room
from calib.effects.context import Context, joint_index, turning_joints
from calib.effects.protocol import (
    ElasticEffect,
    Flexibilities,
    PoseEffect,
    State,
    Twist,
    TwistEffect,
)
from calib.poses import Poses


@dataclass(frozen=True, eq=False)
class AlongJoint(TwistEffect):
    """A twist along the variable of one joint: an error of its reading, or of its drive.

    frame : int, the joint's
    axis : ndarray, shape (6,), unit displacement along the joint's variable
    """

    frame: int
    axis: Array

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


@dataclass(frozen=True, eq=False)
class DriveError(AlongJoint, PoseEffect):
    """An error of a joint's variable: ``dq = shares @ parameters``."""

    @abstractmethod
    def shares(self, poses: Poses) -> Array:
        """D dq / d parameter at each pose, shape (m, p), SI."""

    def twists_at(self, poses: Poses) -> tuple[Twist, ...]:
        return ((self.frame, self.axis[:, None] * self.shares(poses)[:, None, :]),)


@dataclass(frozen=True, eq=False)
class ElasticDrive(AlongJoint, ElasticEffect):
    """A joint that yields along its own variable: ``dq = compliance * torque``.

    Paper, equation 2 with a diagonal k_theta. A drive that moves joint j by ``factor_j`` of its own
    motion feels ``factor_j * torque_j`` of it, by virtual work: it yields under the sum, and all that
    it moves go with it.

    moves : joints that couplings move with it: frame of each, and unit displacement (6,) times factor
    """

    moves: tuple[tuple[int, Array], ...] = field(default=(), kw_only=True)

    @classmethod
    def at(cls, context: Context, where: str) -> Self:
        return replace(super().at(context, where), moves=moves_of(context, where))

    @property
    def _along(self) -> tuple[tuple[int, Array], ...]:
        """Frames that the drive moves and their displacements (6,), its own joint's first."""
        return ((self.frame, self.axis), *self.moves)

    @abstractmethod
    def shares(self, poses: Poses) -> Array:
        """What each parameter adds to the compliance at each pose, shape (m or 1, p)."""

    def flexibilities(self, poses: Poses) -> Flexibilities:
        shares = self.shares(poses)[:, None, None, :]
        return {
            (moved, felt): np.outer(way, axis)[:, :, None] * shares
            for moved, way in self._along
            for felt, axis in self._along
        }

    def twists(self, state: State, values: Array) -> tuple[Twist, ...]:
        local = state.wrench.local
        torque = sum(np.einsum("...i,i->...", local[..., k, :], axis) for k, axis in self._along)
        by = np.asarray(torque)[..., None] * self.shares(state.poses)
        found = []
        for frame, axis in self._along:
            out = room(by.shape[:-1], 6, by.shape[-1])
            out[...] = axis[:, None] * by[..., None, :]
            found.append((frame, out))
        return tuple(found)


def moves_of(context: Context, where: str) -> tuple[tuple[int, Array], ...]:
    """Joints that couplings move with one: the frame of each, and displacement for one of that (6,)."""
    robot, joint = context.robot, joint_index(context, where)
    column = robot.driven[:, joint].tolist()
    return tuple(
        (other + 1, factor * along_axis(robot, other))
        for other, factor in enumerate(column)
        if factor and other != joint
    )


def along_axis(robot: Robot, joint: int) -> Array:
    """Unit displacement along a joint's variable, shape (6,)."""
    part = slice(0, 3) if robot.prismatic[joint] else slice(3, 6)
    unit = np.zeros(6)
    unit[part] = robot.axes[joint]
    return unit


def compliance_unit(prismatic: bool) -> tuple[str, float, float]:
    """Unit of a joint's compliance, its SI scale, and a plausible size.

    Heavy arms have 0.3 to 5 urad/(N m); strain wave gears of the smallest wrists (sizes 11 to 17) some
    1e4 down to 3e3 N m/rad by their makers' tables: 100 to 300 urad/(N m), ten times this.
    """
    return ("nm/N", 1e-9, 1e-6) if prismatic else ("urad/(N m)", 1e-6, 3e-5)


def error_unit(prismatic: bool) -> str:
    """Unit of an error of a joint's variable."""
    return "um" if prismatic else "urad"


def variable_unit(prismatic: bool) -> str:
    """SI unit of a joint's variable, the denominator of errors in proportion to it."""
    return "m" if prismatic else "rad"
