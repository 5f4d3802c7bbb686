"""All six constant errors of every segment of the arm; redundant ones are merged."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

from calib.effects.context import Context
from calib.effects.protocol import ConstantTwist


def segment(context: Context, where: str) -> int:
    """Frame at which a segment ends: the joint's, or the tip's under the name of the tip link."""
    robot = context.robot
    return robot.tip_frame if where == robot.tip else robot.joints.index(where) + 1


@dataclass(frozen=True, eq=False)
class Geometry(ConstantTwist):
    """Displacement of the frame at the end of a segment: a joint's name, or the tip link's."""

    kind: ClassVar[str] = "geometry"
    parts: ClassVar[tuple[str, ...]] = ("joint_offset", "link_geometry")

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        return (*context.robot.joints, context.robot.tip)

    @classmethod
    def at(cls, context: Context, where: str) -> Self:
        return cls(where, segment(context, where))
