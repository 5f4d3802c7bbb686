"""Which readings repeat each other, and between which the arm was elsewhere."""

from __future__ import annotations

import numpy as np

from calib.arrays import IntArray
from calib.poses import Poses
from calib.poses.moves import begins, in_order


def visits(poses: Poses) -> IntArray:
    """Number of the stay to which each reading belongs, shape (m,), in the order of measurement.

    A stay lasts until the arm goes to other joints, or the instrument to another station, or nobody
    knows whether it did. Where poses in between were left out, the size of the last move still tells
    that the arm was elsewhere.
    """
    order = in_order(poses)
    keys = [poses.configuration, poses.station]
    if poses.motion is not None:
        keys += list(poses.motion.T)
    where = np.column_stack(keys)[order]
    left = np.diff(where, axis=0, prepend=where[:1]).any(axis=1) | begins(poses)[order]
    found = np.empty(len(poses), dtype=int)
    found[order] = np.cumsum(left)
    return found


def alike(poses: Poses) -> IntArray:
    """Number of the state of each reading, shape (m,): equal joints, loads and station.

    Unlike ``Poses.repeated`` it does not ask from which side the joints came.
    """
    keys = [poses.configuration, poses.station, poses.load_mass, *poses.wrench.T]
    _, group = np.unique(np.column_stack(keys), axis=0, return_inverse=True)
    return group.reshape(-1)
