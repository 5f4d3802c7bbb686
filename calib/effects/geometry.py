"""Constant errors of the arm: all six of every segment, and those of one link."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from calib.arrays import Array
from calib.effects.context import Context
from calib.effects.protocol import Constant, Parameter


@dataclass(frozen=True, eq=False)
class Geometry(Constant):
    """All six constant errors of every segment of the arm; redundant ones are merged.

    Displacements of the frame at the end of a segment: a joint's name, or the tip link's.

    components : tuple of int, of the displacement, that are parameters
    """

    components: tuple[int, ...] = tuple(range(6))
    kind: ClassVar[str] = "geometry"
    names: ClassVar[tuple[str, ...]] = ("x", "y", "z", "rx", "ry", "rz")
    parts: ClassVar[tuple[str, ...]] = ("joint_offset", "link_geometry")

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        return (*context.robot.joints, *context.robot.tips)

    @classmethod
    def at(cls, context: Context, where: str) -> Self:
        return cls(where, cls.places(context).index(where) + 1)

    @property
    def columns(self) -> Array:
        return np.eye(6)[:, list(self.components)]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return tuple(
            self.parameter(self.names[c], "um" if c < 3 else "urad", 1e-3) for c in self.components
        )

    def only(self, kept: tuple[int, ...]) -> Self:
        """The same with some of its parameters, by their positions."""
        return replace(self, components=tuple(self.components[i] for i in kept))


@dataclass(frozen=True, eq=False)
class LinkGeometry(Geometry):
    """Error of one link: a constant displacement of the frame at its end."""

    kind: ClassVar[str] = "link_geometry"
    parts: ClassVar[tuple[str, ...]] = ()
