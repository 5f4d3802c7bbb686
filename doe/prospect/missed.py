"""Poses that could not be read: what is near them is not proposed again."""

from __future__ import annotations

import numpy as np

from calib.arm.robot import Robot
from calib.arrays import Array, Mask
from calib.poses import Poses


def likely_read(robot: Robot, q: Array, read: Poses, missed: Poses | None) -> Mask:
    """Configurations (m, dof) whose nearest tried one, over the joints' ranges, could be read, (m,).

    What hides a marker or bars the way is seldom a point; how far it goes nobody has said. All, where
    none was missed.
    """
    if missed is None or not len(missed):
        return np.ones(len(q), dtype=bool)
    low, high = robot.sample_limits().T
    span = np.where(high > low, high - low, 1.0)
    return np.asarray(_nearest(q / span, read.q / span) < _nearest(q / span, missed.q / span))


def _nearest(q: Array, others: Array) -> Array:
    """Squared distance of each of (m, dof) to the nearest of others (n, dof), shape (m,)."""
    if not len(others):
        return np.full(len(q), np.inf)
    return np.asarray(((q[:, None] - others) ** 2).sum(axis=-1).min(axis=1))


def refusal(missed: Poses | None) -> str:
    """Why no configuration is left to propose."""
    if missed is None or not len(missed):
        return "no configuration satisfies the cell's constraints; relax [design]"
    return (
        f"all candidates are nearer to one of {len(missed)} missed poses than to any that was read; "
        "leave out those that were missed by accident"
    )
