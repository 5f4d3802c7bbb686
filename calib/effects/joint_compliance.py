"""Elastic drive of a joint: ``dq = compliance * torque`` (paper, equation 2, diagonal k_theta)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from calib.effects.protocol import (
    AlongJoint,
    ElasticEffect,
    Parameter,
    compliance_unit,
)
from calib.poses import Poses
from calib.se3 import Array


@dataclass(frozen=True, eq=False)
class JointCompliance(AlongJoint, ElasticEffect):
    """Compliance along one joint's variable."""

    kind: ClassVar[str] = "joint_compliance"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        unit, scale, size = compliance_unit(self.slides)
        return (Parameter(self.kind, self.where, "compliance", unit, scale, size),)

    def flexibility(self, poses: Poses) -> Array:
        return np.outer(self.axis, self.axis)[None, :, :, None]
