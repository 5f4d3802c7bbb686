"""Readings taken before the arm is at rest: a part of each joint's last move is still missing.

``dq = -(per_move move + per_speed move / longest)``. A lag leaves a share of the move itself, or
of the speed near its end. In a synchronised move this speed is the joint's share of the longest
move.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from calib.arrays import Array
from calib.effects.drive import DriveError, error_unit, variable_unit
from calib.effects.protocol import Parameter
from calib.poses import Poses

# 0.05 deg of a move of a radian or so was seen.
_SIZE, _LARGEST = 1e-3, 1e-2


@dataclass(frozen=True, eq=False)
class Settling(DriveError):
    """What one joint lacks of its last move."""

    kind: ClassVar[str] = "settling"
    uses: ClassVar[tuple[str, ...]] = ("motion", "approach")

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        unit = error_unit(self.slides)
        named = (("per_move", f"{unit}/{variable_unit(self.slides)}"), ("per_speed", unit))
        return tuple(
            Parameter(self.kind, self.where, name, own, 1e-6, _SIZE, _LARGEST)
            for name, own in named
        )

    def shares(self, poses: Poses) -> Array:
        if poses.motion is None or poses.approach is None:
            return np.zeros((len(poses), 2))
        joint = self.frame - 1
        move = poses.approach[:, joint] * poses.motion[:, joint]
        longest = poses.motion.max(axis=1)
        share = np.divide(move, longest, out=np.zeros(len(poses)), where=longest > 0.0)
        return -np.column_stack([move, share])
