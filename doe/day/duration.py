"""How long the arm takes from pose to pose."""

from __future__ import annotations

import numpy as np

from calib.arrays import Array
from calib.cell import Cell

_FULL_SPEED_IN = 0.5  # s, from rest, where no acceleration is given


def paced(cell: Cell) -> bool:
    """Whether the speeds of all joints are known."""
    speeds = cell.robot.speeds
    return speeds is not None and not np.isnan(speeds).any()


def limits_of(cell: Cell) -> tuple[Array, Array]:
    """Speeds and accelerations of the joints on a day (dof,), rad/s or m/s and these per second.

    Where not all speeds are known, the joints count as equally fast, one a second.
    """
    robot, share = cell.robot, cell.pace.speed
    speeds = robot.speeds if robot.speeds is not None and paced(cell) else np.ones(robot.dof)
    given = np.full(robot.dof, np.nan) if robot.accelerations is None else robot.accelerations
    return share * speeds, share * np.where(np.isnan(given), speeds / _FULL_SPEED_IN, given)


def durations(cell: Cell, steps: Array) -> Array:
    """Seconds that straight motions (.., dof), rad or m, take from rest to rest, shape (..).

    All joints begin and end together: the slowest one is accelerated, driven at its speed and braked.
    Where not all speeds are known it only compares motions (:func:`limits_of`).
    """
    far, (speeds, accelerations) = np.abs(steps), limits_of(cell)
    cruises = far * accelerations >= speeds**2
    brief = 2.0 * np.sqrt(far / accelerations)
    return np.asarray(np.where(cruises, far / speeds + speeds / accelerations, brief).max(axis=-1))


def travel(q: Array) -> float:
    """Joint travel of a sequence q, shape (m, n), of joints of one unit: of each move the farthest."""
    return float(np.abs(np.diff(q, axis=0)).max(axis=1, initial=0.0).sum())
