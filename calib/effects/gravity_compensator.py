"""Torque of a balancing spring between the two links of a joint.

The spring runs from an anchor P0 on the link before the joint to an anchor P2 on the link after it
and pulls with ``F = preload + spring * (s - s(0))``, s its length. About the joint's axis a, with the
anchors given from the joint's origin, its torque on the link is ``F / s * a . (P2 x P0)``, the
M_c of the compensator model of Klimchik et al. (ICRA 2013), which this project writes with the force
at zero angle in place of the free length. The spring also stiffens the joint, far less than a
drive's own stiffness varies: that part belongs to ``stiffness_vs_angle``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from calib.effects.protocol import Context, LoadEffect, Parameter, joint_index, needs
from calib.poses import Poses
from calib.se3 import Array, cross, rotate, so3_exp


@dataclass(frozen=True, eq=False)
class GravityCompensator(LoadEffect):
    """Spring and preload of a compensator on a revolute joint, evaluated at the angle as read."""

    joint: int
    frames: int
    axis: Array
    anchors: Array
    kind: ClassVar[str] = "gravity_compensator"

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        return tuple(j for j in context.robot.joints if j in context.anchors)

    @classmethod
    def at(cls, context: Context, where: str) -> Self:
        needs(
            where in context.anchors,
            f"{cls.kind}:{where}",
            "where its spring is anchored is not known",
            f"add [robot.compensators_mm] {where} = {{ before = [x, y, z], after = [x, y, z] }}",
        )
        joint, robot = joint_index(context, where), context.robot
        return cls(where, joint, robot.dof + 2, robot.axes[joint], context.anchors[where])

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (
            Parameter(self.kind, self.where, "spring", "N/mm", 1e3, 1e5),
            Parameter(self.kind, self.where, "preload", "N", 1.0, 1e4),
        )

    def spring_length(self, q: Array) -> Array:
        """Length of the spring [m] at joint angles q [rad]."""
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
