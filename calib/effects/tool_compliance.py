"""Elastic flange and tool: the tip frame moves in proportion to the wrench on it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from calib.arrays import Array
from calib.effects.context import Context
from calib.effects.protocol import ElasticEffect, Parameter
from calib.poses import Poses

_LARGEST = 5e-4  # rad/(N m): a changer or a slender tool


@dataclass(frozen=True, eq=False)
class ToolCompliance(ElasticEffect):
    """Six compliances of the tip frame, one for each component of force and moment."""

    kind: ClassVar[str] = "tool_compliance"

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        return ("tool",)

    @classmethod
    def at(cls, context: Context, where: str) -> Self:
        return cls(where, context.robot.tip_frame)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        slide = [Parameter(self.kind, self.where, c, "nm/N", 1e-9, 1e-7) for c in "xyz"]
        turn = [
            Parameter(self.kind, self.where, f"r{c}", "urad/(N m)", 1e-6, 1e-6, _LARGEST)
            for c in "xyz"
        ]
        return (*slide, *turn)

    def flexibility(self, poses: Poses) -> Array:
        diagonal = np.zeros((1, 6, 6, 6))
        diagonal[0, range(6), range(6), range(6)] = 1.0
        return diagonal
