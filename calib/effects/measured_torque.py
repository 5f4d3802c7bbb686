"""Elastic drive under the torque that the arm measured: ``dq = compliance * torque``.

The torque comes from the columns ``<joint>_Nm``, positive along the joint's motion. A constant
torque error counts as an error of the joint's zero.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from calib.arrays import Array
from calib.effects.drive import DriveError, compliance_unit
from calib.effects.protocol import Parameter
from calib.poses import Poses

_LARGEST = 5e-4  # rad/(N m): joints with torque sensors yield by 30 to 100 urad/(N m)


@dataclass(frozen=True, eq=False)
class MeasuredTorque(DriveError):
    """Compliance of one joint under what its own sensor, or its current, says."""

    kind: ClassVar[str] = "measured_torque"
    uses: ClassVar[tuple[str, ...]] = ("torque",)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        unit, scale, size = compliance_unit(self.slides)
        largest = None if self.slides else _LARGEST
        return (Parameter(self.kind, self.where, "compliance", unit, scale, size, largest),)

    def shares(self, poses: Poses) -> Array:
        if poses.torque is None:
            return np.zeros((len(poses), 1))
        return poses.torque[:, self.frame - 1, None]
