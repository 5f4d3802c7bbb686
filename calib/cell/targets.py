"""Target poses: where accuracy is wanted."""

from __future__ import annotations

import numpy as np

from calib.arrays import Array
from calib.cell import Cell
from calib.errors import CalibError
from calib.poses import Poses, hung, poses_at

_COUNT = 200
_OUTSIDE = 1e-4  # rad or m: rounding of limits


def targets_of(cell: Cell) -> tuple[Poses, Array]:
    """The cell's own targets and weights (m,), else 200 Sobol poses within the limits, seed 0."""
    own = cell.design.targets
    if own is not None:
        return own.poses, own.weights
    poses = poses_at(cell.robot.sobol(_COUNT))
    if cell.load is not None:
        poses = hung(poses, cell.load.mass, cell.load.com)
    return poses, np.ones(_COUNT)


def check_targets(cell: Cell, targets: Poses) -> None:
    """Refuse targets outside the joint limits. Raises CalibError."""
    low, high = cell.robot.limits.T
    outside = (targets.q < low - _OUTSIDE) | (targets.q > high + _OUTSIDE)
    for i, j in np.argwhere(outside)[:1]:
        slides = cell.robot.prismatic[j]
        unit, name = (1e-3, "mm") if slides else (np.pi / 180.0, "deg")
        raise CalibError(
            f"target {targets.names[i]}: {cell.robot.joints[j]} at {targets.q[i, j] / unit:.2f} {name} "
            f"is outside its limits {low[j] / unit:.2f} .. {high[j] / unit:.2f}; move it inside"
        )
