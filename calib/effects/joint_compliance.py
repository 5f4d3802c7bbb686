"""Elastic drive of a joint: ``dq = compliance * torque`` (paper, equation 2, diagonal k_theta)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from calib.arrays import Array
from calib.effects.context import Context, Expectation
from calib.effects.drive import ElasticDrive, compliance_unit
from calib.effects.protocol import Parameter
from calib.effects.usual import softer
from calib.poses import Poses


@dataclass(frozen=True, eq=False)
class JointCompliance(ElasticDrive):
    """Compliance along one joint's variable."""

    kind: ClassVar[str] = "joint_compliance"

    @classmethod
    def expected(cls, context: Context, where: str) -> Expectation:
        return Expectation(allowance=softer(context))

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        unit, scale, size = compliance_unit(self.slides)
        return (Parameter(self.kind, self.where, "compliance", unit, scale, size),)

    def shares(self, poses: Poses) -> Array:
        return np.ones((1, 1))
