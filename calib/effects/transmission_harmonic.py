"""Gear errors that repeat with the joint's turn: eccentricity (once) and ovality (twice).

Data sheets of strain wave gears state 1 to 1.5 arc minutes from peak to peak: 150 to 220 urad.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from calib.arrays import Array
from calib.effects.drive import DriveError
from calib.effects.protocol import Parameter
from calib.poses import Poses


@dataclass(frozen=True, eq=False)
class TransmissionHarmonic(DriveError):
    """``dq = cos_1 cos q + sin_1 sin q + cos_2 cos 2q + sin_2 sin 2q``, q as read."""

    kind: ClassVar[str] = "transmission_harmonic"
    turns: ClassVar[bool] = True

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        names = ("cos_1", "sin_1", "cos_2", "sin_2")
        return tuple(Parameter(self.kind, self.where, n, "urad", 1e-6, 2e-4) for n in names)

    def shares(self, poses: Poses) -> Array:
        q = poses.q[:, self.frame - 1]
        return np.column_stack([np.cos(q), np.sin(q), np.cos(2 * q), np.sin(2 * q)])
