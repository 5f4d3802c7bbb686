"""Zero error of a joint: ``q_true = q_read + offset``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from calib.arrays import Array
from calib.effects.drive import AlongJoint, error_unit
from calib.effects.protocol import Constant, Parameter


@dataclass(frozen=True, eq=False)
class JointOffset(AlongJoint, Constant):
    """Constant error of one joint variable."""

    kind: ClassVar[str] = "joint_offset"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        unit = error_unit(self.slides)
        return (Parameter(self.kind, self.where, "offset", unit, 1e-6, 1e-3),)

    @property
    def columns(self) -> Array:
        return self.axis[:, None]
