"""Joint limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, Mask
from calib.cell import Cell
from doe.constraints.protocol import Constraint
from doe.constraints.scene import Scene

_SLACK = 1e-9  # rad or m; a limit that is converted from degrees is still reached


@dataclass(frozen=True, eq=False)
class JointLimits(Constraint):
    """Every joint within its limits, ndarray of shape (dof, 2), rad or m."""

    limits: Array
    name: str = "joint_limits"

    def allows(self, scene: Scene) -> Mask:
        low, high = self.limits[:, 0] - _SLACK, self.limits[:, 1] + _SLACK
        return np.asarray(((scene.q >= low) & (scene.q <= high)).all(axis=1))


def joint_limits(cell: Cell) -> JointLimits | None:
    """The limits of the cell's robot; None where all its joints turn without end."""
    limits = cell.robot.limits
    return JointLimits(limits) if np.isfinite(limits).any() else None
