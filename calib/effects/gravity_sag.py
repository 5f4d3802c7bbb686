"""Sag of joints under the arm's own weight, for unknown link masses.

The weight of all links beyond joint k turns it by ``compliance * a_k . sum_l (R_l b_l) x g``.
Here b_l is the first moment of link l, with everything that hangs beyond it. Compliance and
moment are both unknown, so the parameters are their products with g.

The part of b_l along joint l's own axis belongs to the link before. A joint that turns therefore
has two parameters across its axis, ``u_<joint>`` and ``v_<joint>``. A joint that slides shifts
everything beyond it: ``travel_<joint>``. Under a joint that slides itself, weight and compliance
have one product. The angles are those that were read. The arm's own deflection changes them too
little to matter.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from calib.arm.kinematics import forward
from calib.arm.robot import Robot
from calib.arm.se3 import across, cross, rotate
from calib.arrays import Array
from calib.effects.context import ARM, Context, Expectation, joint_index
from calib.effects.drive import along_axis, error_unit
from calib.effects.protocol import Parameter, PoseEffect, Twist
from calib.effects.usual import light
from calib.poses import Poses

_SIZE = 1e-4  # rad, or m
_LARGEST = 1e-2  # of a light arm's joint, 10 urad/(N m), under 1000 N m
_KNOWN = "the masses of the links are known: joint_compliance and link_weight say how the arm sags"
_SERVICE = 3.0  # strain-wave joints of 300 to 450 urad/(N m) under 70 N m (DLR Agile Justin)


@dataclass(frozen=True, eq=False)
class GravitySag(PoseEffect):
    """Sag of one joint, or of every joint (``arm``).

    robot : Robot
    sagging : tuple of int, positions of the joints that sag
    down : ndarray, shape (3,), unit vector of gravity in base axes
    """

    robot: Robot
    sagging: tuple[int, ...]
    down: Array
    kind: ClassVar[str] = "gravity_sag"

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        return (ARM, *context.robot.joints)

    @classmethod
    def at(cls, context: Context, where: str) -> Self:
        robot = context.robot
        joints = range(robot.dof) if where == ARM else [joint_index(context, where)]
        size = float(np.linalg.norm(context.gravity))
        return cls(where, robot, tuple(joints), context.gravity / (size or 1.0))

    @classmethod
    def expected(cls, context: Context, where: str) -> Expectation:
        return Expectation(
            allowance=_SERVICE if light(context) else 1.0,
            instead=_KNOWN if context.robot.masses.any() else "",
        )

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        found = []
        for k in self.sagging:
            unit = error_unit(bool(self.robot.prismatic[k]))
            prefix = f"{self.robot.joints[k]}_" if self.where == ARM else ""
            for name, slides in self._moments(k):
                own = f"{unit}/m" if slides else unit
                found.append(
                    Parameter(self.kind, self.where, prefix + name, own, 1e-6, _SIZE, _LARGEST)
                )
        return tuple(found)

    def contains(self, kind: str, where: str) -> bool:
        return kind == self.kind and self.where == ARM != where

    def _moments(self, k: int) -> list[tuple[str, bool]]:
        """Names of the products at joint k, and whether a joint's travel multiplies them."""
        robot = self.robot
        if robot.prismatic[k]:
            return [("weight", False)]
        names: list[tuple[str, bool]] = []
        for j in robot.beyond(k):
            joint, slides = robot.joints[j], bool(robot.prismatic[j])
            own = [f"travel_{joint}"] if slides else [f"u_{joint}", f"v_{joint}"]
            names += [(name, slides) for name in own]
        return names

    def twists_at(self, poses: Poses) -> tuple[Twist, ...]:
        R = forward(self.robot, poses.q).R_link
        twists, first, count = [], 0, len(self.parameters)
        for k in self.sagging:
            turned = self._turned(k, R, poses.q)
            columns = np.zeros((len(poses), count))
            columns[:, first : first + turned.shape[1]] = turned
            first += turned.shape[1]
            axis = along_axis(self.robot, k)
            twists.append((k + 1, axis[:, None] * columns[:, None, :]))
        return tuple(twists)

    def _turned(self, k: int, R: Array, q: Array) -> Array:
        """D dq_k / d product, shape (m, products)."""
        robot = self.robot
        axis = rotate(R[:, k + 1], robot.axes[k])  # the joint's own motion leaves its axis in place
        if robot.prismatic[k]:
            return (axis @ self.down)[:, None]
        columns = []
        for j in robot.beyond(k):
            if robot.prismatic[j]:
                moments = robot.axes[j] * q[:, j, None, None]
            else:
                moments = across(robot.axes[j])[None]
            in_base = rotate(R[:, j + 1, None], moments)
            columns.append(np.sum(axis[:, None, :] * cross(in_base, self.down), axis=-1))
        return np.concatenate(columns, axis=1)
