"""Links that are longer than the nominal model by the temperature."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from calib.arm.robot import Robot
from calib.arrays import Array
from calib.effects.context import ARM, Context, joint_index, needs
from calib.effects.protocol import PoseEffect, Twist, Unknown
from calib.poses import Poses

# 1/K: aluminium grows by 23e-6, and a link beside its motor warms by more than the thermometer shows.
_LARGEST = 4e-4


@dataclass(frozen=True, eq=False)
class ThermalExpansion(PoseEffect):
    """Links that grow with temperature; the nominal model holds at 20 degC.

    A link grows along its constant translation, from its joint to the origin of the next one (or to
    the tip). ``arm`` means that the whole arm warms up, including the base link up to the first joint.

    ends : tuple of int, the frames in which the growing links end
    lengths : ndarray, shape (ends, 3), m, the links' translations in the axes of those frames
    """

    ends: tuple[int, ...]
    lengths: Array
    kind: ClassVar[str] = "thermal_expansion"
    uses: ClassVar[tuple[str, ...]] = ("temperature",)
    unknowns: ClassVar[tuple[Unknown, ...]] = (("growth", "um/(m K)", 1e-5, _LARGEST),)

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        robot = context.robot
        grown = zip(robot.parents, translations(robot), strict=True)
        long = {parent for parent, length in grown if length.any()}
        return (ARM, *(joint for k, joint in enumerate(robot.joints, 1) if k in long))

    @classmethod
    def at(cls, context: Context, where: str) -> Self:
        robot, lengths = context.robot, translations(context.robot)
        if where == ARM:
            return cls(where, tuple(range(1, robot.frame_count)), lengths)
        link = joint_index(context, where) + 1
        ends = [frame for frame, parent in enumerate(robot.parents, 1) if parent == link]
        lengths = lengths[np.array(ends, dtype=int) - 1]
        needs(
            bool(lengths.any()),
            f"{cls.kind}:{where}",
            "the next joint has its origin in this one's",
            "name a link that has a length, or arm",
        )
        return cls(where, tuple(ends), lengths)

    def twists_at(self, poses: Poses) -> tuple[Twist, ...]:
        slides = np.column_stack([self.lengths, np.zeros_like(self.lengths)])
        grown = poses.warming[:, None, None] * slides[:, None, :, None]
        return tuple(zip(self.ends, grown, strict=True))


def translations(robot: Robot) -> Array:
    """Origin of each frame but the base's from the one it hangs on, in its own axes, (F - 1, 3), m."""
    R, p = robot.origins[:, :3, :3], robot.origins[:, :3, 3]
    return np.asarray((p[:, None, :] @ R)[:, 0])
