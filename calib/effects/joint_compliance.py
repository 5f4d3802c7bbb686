"""Elastic drive of a joint: ``dq = compliance * torque`` (paper, equation 2, diagonal k_theta)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from calib.effects.protocol import (
    Context,
    ElasticEffect,
    Parameter,
    along_axis,
    compliance_unit,
    joint_index,
)
from calib.poses import Poses
from calib.se3 import Array


@dataclass(frozen=True, eq=False)
class JointCompliance(ElasticEffect):
    """Compliance along one joint's variable."""

    axis: Array
    kind: ClassVar[str] = "joint_compliance"

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        return context.robot.joints

    @classmethod
    def at(cls, context: Context, where: str) -> Self:
        joint = joint_index(context, where)
        return cls(where, joint + 1, along_axis(context.robot, joint))

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        unit, scale, size = compliance_unit(bool(self.axis[:3].any()))
        return (Parameter(self.kind, self.where, "compliance", unit, scale, size),)

    def flexibility(self, poses: Poses) -> Array:
        return np.outer(self.axis, self.axis)[None, :, :, None]
