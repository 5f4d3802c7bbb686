"""The last move before a pose: from which side each joint comes, as a plan prescribes it."""

from __future__ import annotations

import numpy as np

from calib.arrays import Array
from calib.cell import Cell
from calib.poses import Poses

LAST_MOVES = (np.radians([5.0, 40.0, 120.0]), np.array([0.02, 0.1, 0.3]))
"""Sizes of a last move, of joints that turn [rad] and slide [m]; the first takes up lost motion."""


def last_move(cell: Cell, poses: Poses) -> Array | None:
    """The last move of each joint to each pose (m, dof), rad or m, with its sign.

    As the plan prescribes it; of the usual size where it tells the sides alone. None where it
    prescribes none.
    """
    if poses.approach is None or poses.approach_derived:
        return None
    if poses.motion is not None and poses.motion_told:
        return poses.approach * poses.motion
    turned, slid = LAST_MOVES
    return np.asarray(poses.approach * np.where(cell.robot.prismatic, slid[0], turned[0]))
