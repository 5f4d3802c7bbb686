"""Constant errors of the arm: all six of every segment, and those of one link."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

from calib.effects.context import Context
from calib.effects.protocol import ConstantTwist


@dataclass(frozen=True, eq=False)
class Geometry(ConstantTwist):
    """All six constant errors of every segment of the arm; redundant ones are merged.

    Displacements of the frame at the end of a segment: a joint's name, or the tip link's.
    """

    kind: ClassVar[str] = "geometry"
    parts: ClassVar[tuple[str, ...]] = ("joint_offset", "link_geometry")

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        return (*context.robot.joints, *context.robot.tips)

    @classmethod
    def at(cls, context: Context, where: str) -> Self:
        return cls(where, cls.places(context).index(where) + 1)


@dataclass(frozen=True, eq=False)
class LinkGeometry(Geometry):
    """Error of one link: a constant displacement of the frame at its end."""

    kind: ClassVar[str] = "link_geometry"
    parts: ClassVar[tuple[str, ...]] = ()
