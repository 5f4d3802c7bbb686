"""Inverse kinematics of the nominal robot: joint values that put its tip where it is wanted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arm.approach import approached, turns
from calib.arm.kinematics import Frames, forward, point_slopes
from calib.arm.robot import Robot
from calib.arm.se3 import so3_log
from calib.arrays import Array, IntArray

_STARTS = 64
_PATIENCE = 20  # steps after which a start that is still far is given up
_THERE = 1e-8  # m, and of a metre of reach: what is left where a target is met
_TURN = 2.0 * np.pi


@dataclass(frozen=True, eq=False)
class Solutions:
    """What many starts find for one target.

    q : ndarray, shape (k, n), rad or m, within the joint limits; none out of reach
    short, turned : float, m and rad, by how much the best start missed place and orientation
    """

    q: Array
    short: float
    turned: float

    def nearest(self, robot: Robot, reference: Array) -> Array:
        """The one nearest to joint values (n,), whole turns within the limits aside."""
        low, high = robot.limits.T
        free = ~robot.prismatic & ~robot.coupled
        whole = np.where(free, np.round((reference - self.q) / _TURN), 0.0)
        moved = self.q + whole * _TURN
        q = np.where((moved >= low) & (moved <= high), moved, self.q)
        away = (q - reference) / np.where(robot.prismatic, robot.reach, 1.0)
        return np.asarray(q[int(np.linalg.norm(away, axis=1).argmin())])


def solutions(robot: Robot, R: Array, o: Array) -> list[Solutions]:
    """Solutions for tips R (m, 3, 3), o (m, 3) [m], in base axes."""
    of = np.repeat(np.arange(len(o)), _STARTS)

    def missed(now: IntArray, arm: Frames) -> tuple[Array, Array]:
        turn = so3_log(arm.R[:, -1] @ np.swapaxes(R[of[now]], -1, -2))
        off = np.concatenate([arm.o[:, -1] - o[of[now]], robot.reach * turn], axis=1)
        slopes = [point_slopes(robot, arm, arm.o[:, -1]), robot.reach * turns(robot, arm)]
        return off, np.concatenate(slopes, axis=1)

    starts = np.tile(robot.sobol(_STARTS), (len(o), 1))
    q = approached(robot, starts, np.asarray(robot.free), missed, patience=_PATIENCE)
    off = missed(np.arange(len(q)), forward(robot, q))[0].reshape(len(o), _STARTS, 6)
    q = q.reshape(len(o), _STARTS, -1)
    return [_of_one(robot, *one) for one in zip(q, off, strict=True)]


def _of_one(robot: Robot, q: Array, off: Array) -> Solutions:
    sizes = np.linalg.norm(off, axis=1)
    best = off[int(sizes.argmin())]
    turned = float(np.linalg.norm(best[3:])) / robot.reach
    return Solutions(q[sizes < _THERE], float(np.linalg.norm(best[:3])), turned)
