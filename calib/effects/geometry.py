"""Constant errors of the arm: all six of every segment, those of one link, and the zero of a joint."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

from calib.arrays import Array
from calib.effects.context import Context
from calib.effects.drive import AlongJoint, error_unit
from calib.effects.protocol import Constant, ConstantTwist, Parameter


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
        robot = context.robot
        return cls(where, (*robot.joints, *robot.tips).index(where) + 1)


@dataclass(frozen=True, eq=False)
class LinkGeometry(Geometry):
    """Error of one link: a constant displacement of the frame at its end."""

    kind: ClassVar[str] = "link_geometry"
    parts: ClassVar[tuple[str, ...]] = ()


@dataclass(frozen=True, eq=False)
class JointOffset(AlongJoint, Constant):
    """Zero error of a joint: ``q_true = q_read + offset``."""

    kind: ClassVar[str] = "joint_offset"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        unit = error_unit(self.slides)
        return (Parameter(self.kind, self.where, "offset", unit, 1e-6, 1e-3),)

    @property
    def columns(self) -> Array:
        return self.axis[:, None]
