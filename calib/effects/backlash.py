"""Lost motion of a joint: its position depends on the approach direction.

``dq = half_width * approach``. The approach direction is the sign of the joint's last motion, and 0
where it is unknown. A negative half width is ordinary lost motion: the joint stops before its target,
because it is read at the motor. A positive half width goes too far, as with a controller that
compensates too much. A usual value for a robot's gear is one arc minute from side to side, 290
urad. Worn and small gears have more.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from calib.arrays import Array
from calib.effects.context import Context, Expectation
from calib.effects.drive import DriveError, error_unit
from calib.effects.protocol import Parameter
from calib.effects.usual import light
from calib.poses import Poses

_SERVO = 10.0  # 2 mrad become 20: geared servos have 4 to 6 when new (ROBOTIS, MX-28 and XM430)


@dataclass(frozen=True, eq=False)
class Backlash(DriveError):
    """Half the gap between both approaches of one joint."""

    kind: ClassVar[str] = "backlash"
    uses: ClassVar[tuple[str, ...]] = ("approach",)

    @classmethod
    def expected(cls, context: Context, where: str) -> Expectation:
        return Expectation(allowance=_SERVO if light(context) else 1.0)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        unit = error_unit(self.slides)
        return (Parameter(self.kind, self.where, "half_width", unit, 1e-6, 2e-4),)

    def shares(self, poses: Poses) -> Array:
        if poses.approach is None:
            return np.zeros((len(poses), 1))
        return poses.approach[:, self.frame - 1, None]
