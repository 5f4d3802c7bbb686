"""Torque of a balancing spring between the two links of a joint.

The spring runs from an anchor P0 on the link before the joint to an anchor P2 on the link after
it. It pulls with ``F = preload + spring * (s - s(0))``, where s is its length. Its torque about
the joint's axis a is ``F / s * a . (P2 x P0)``, with the anchors measured from the joint's
origin. This is the torque M_c of the compensator model of Klimchik et al. (ICRA 2013). Here the
force at zero angle takes the place of the free length.

The spring also stiffens the joint. This part is far smaller than the variation of the drive's own
stiffness, and it belongs to ``stiffness_vs_angle``.

The cell can give the anchors. Otherwise they are taken where a spring balances best at zero
angles. P0 is straight above the joint, at a fifth of the arm's reach. P2 is on the link beyond,
at a twentieth of the reach. On the KR 270 this gives 0.59 m and 0.15 m; its own anchors are at
0.70 m and 0.18 m. The torque then opposes the link's weight on a robot of any size.

Spring and preload are those of an equivalent spring. Other distances give nearly the same torque
curves with other values.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from calib.arm.kinematics import forward
from calib.arm.se3 import across, cross, rotate, so3_exp
from calib.arrays import Array
from calib.effects.context import Context, Expectation, joint_index, turning_joints
from calib.effects.protocol import Parameter, SpringEffect
from calib.effects.usual import heavy
from calib.poses import Poses

_ABOVE, _ALONG = 1 / 5, 1 / 20  # of the arm's reach: distances of the default anchors
_LAST = 1  # the second joint that turns is the last that makers balance, on heavy arms
_SELDOM, _NEVER = 1e-2, 1e-4  # odds elsewhere, and at the elbow and the wrist
_TOO_STEEP = 0.1  # sine of a direction to the joint's axis below which it is no direction across


@dataclass(frozen=True, eq=False)
class GravityCompensator(SpringEffect):
    """Spring and preload of a compensator on a revolute joint, evaluated at the angle as read."""

    joint: int
    frames: int
    axis: Array
    anchors: Array
    kind: ClassVar[str] = "gravity_compensator"
    turns: ClassVar[bool] = True

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        return turning_joints(context)

    @classmethod
    def at(cls, context: Context, where: str) -> Self:
        joint, robot = joint_index(context, where), context.robot
        given = context.anchors.get(where)
        anchors = default_anchors(context, joint) if given is None else given
        return cls(where, joint, robot.frame_count, robot.axes[joint], anchors)

    @classmethod
    def expected(cls, context: Context, where: str) -> Expectation:
        if where in context.anchors:
            return Expectation()
        turning = [j for j, slides in zip(context.robot.joints, context.robot.prismatic, strict=True)
                   if not slides]  # fmt: skip
        if turning.index(where) > _LAST:
            return Expectation(odds=_NEVER)
        return Expectation(
            odds=1.0 if heavy(context) and turning.index(where) == _LAST else _SELDOM
        )

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (
            Parameter(self.kind, self.where, "spring", "N/mm", 1e3, 1e5),
            Parameter(self.kind, self.where, "preload", "N", 1.0, 1e4),
        )

    @property
    def varies_with(self) -> str:
        return f"q:{self.where}"

    def spring_length(self, q: Array) -> Array:
        """Length of the spring, m, at joint angles q, rad; both of one shape."""
        before, after = self.anchors
        moved = rotate(so3_exp(self.axis * q[..., None]), after)
        return np.asarray(np.linalg.norm(moved - before, axis=-1))

    def wrench_basis(self, poses: Poses) -> Array:
        q = poses.q[:, self.joint]
        before, after = self.anchors
        moved = rotate(so3_exp(self.axis * q[:, None]), after)
        s = self.spring_length(q)
        lever = cross(moved, np.broadcast_to(before, moved.shape)) @ self.axis / s
        stretch = s - self.spring_length(np.zeros(()))
        basis = np.zeros((len(q), self.frames, 6, 2))
        per_parameter = np.stack([stretch * lever, lever], axis=-1)
        basis[:, self.joint + 1, 3:, :] = self.axis[:, None] * per_parameter[:, None, :]
        return basis


def default_anchors(context: Context, joint: int) -> Array:
    """Anchors of an equivalent spring, before and after the joint, shape (2, 3), m, joint's frame."""
    robot = context.robot
    frames = forward(robot, np.zeros((1, robot.dof)))
    R, o = frames.R[0, joint + 1], frames.o[0]
    carried = np.flatnonzero(robot.carries[joint + 1])[1:]
    beyond = list((o[carried] - o[joint + 1]) @ R)
    either, other = across(robot.axes[joint])
    above = _first_across(robot.axes[joint], [-context.gravity @ R], either)
    along = _first_across(robot.axes[joint], beyond, other)
    return robot.reach * np.stack([_ABOVE * above, _ALONG * along])


def _first_across(axis: Array, directions: list[Array], otherwise: Array) -> Array:
    """Unit vector across the axis of the first direction that has such a part."""
    for direction in directions:
        part = direction - axis * (axis @ direction)
        size = float(np.linalg.norm(part))
        if size > _TOO_STEEP * float(np.linalg.norm(direction)):
            return np.asarray(part / size)
    return otherwise
