"""Commands: joint values at which the arm as identified stands in a wanted pose, bent by its loads."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from calib.arm.approach import turns
from calib.arm.kinematics import Frames, point_slopes
from calib.arm.robot import Robot
from calib.arm.se3 import rotate, so3_log
from calib.arm.ties import reachable
from calib.arrays import Array, IntArray, Mask
from calib.errors import NoEquilibrium
from calib.model import Model
from calib.poses import Poses

_ROUNDS = 25
_SETTLED = 1e-10  # rad or m, largest step of a joint
_STILL = 1e-8  # the same where other targets take longer
_SWINGS = (0.4, 0.2, 0.05)
"""The most a direction may ask of a joint, rad or share of the reach; less where much was given up."""
_FARTHEST = 0.6  # the same of the whole way
_WEAKEST = 2e-3  # over the swing: lever, in lengths of the tool, below which a direction is none
_TOOL = 0.1  # of the reach: length of a tool of which only the tip's origin is known
_POSITION_FIRST = 1e-3  # weight of orientation where the joints are too few for both


class Reached(NamedTuple):
    """Commands for m targets.

    q : ndarray, shape (m, n), rad or m
    held : ndarray of bool, shape (m, n), joints that stopped at a limit
    lost : ndarray of int, shape (m,), directions given up because the arm hardly moves along them
    settled : ndarray of bool, shape (m,); where it is false, q is the command as given
    missed : ndarray, shape (m,), m, root of what was minimised
    """

    q: Array
    held: Mask
    lost: IntArray
    settled: Mask
    missed: Array


@dataclass(frozen=True, eq=False)
class Goal:
    """Wanted tip frames in base axes and the points that are to be in place.

    R, o : ndarray, shapes (m, 3, 3) and (m, 3), m
    points : ndarray, shape (k, 3), m, tip frame
    tip : int, frame of that tip; that of ``robot.tip`` without
    """

    R: Array
    o: Array
    points: Array
    tip: int = -1

    @property
    def centre(self) -> Array:
        """Mean of the points, shape (3,), m, tip frame."""
        return np.asarray(self.points.mean(axis=0))

    def length(self, robot: Robot) -> float:
        """What a radian weighs beside a metre: how far the points lie from their mean, RMS, m."""
        spread = float(np.sqrt(((self.points - self.centre) ** 2).sum(axis=1).mean()))
        tool = spread if spread > 0.0 else _TOOL * robot.reach
        return tool if robot.free.sum() >= 6 else _POSITION_FIRST * tool

    def missed(self, arm: Frames) -> tuple[Array, Array]:
        """RMS distance [m] of the points from their places, and angle [rad], both (m,)."""
        R, o = arm.R[:, self.tip], arm.o[:, self.tip]
        apart = rotate((R - self.R)[:, None], self.points) + (o - self.o)[:, None]
        turn = so3_log(R @ np.swapaxes(self.R, -1, -2))
        return np.sqrt((apart**2).sum(axis=-1).mean(axis=-1)), np.linalg.norm(turn, axis=-1)

    def take(self, index: IntArray) -> Goal:
        """The goals of some targets."""
        return replace(self, R=self.R[index], o=self.o[index])


def tip_of(model: Model, values: Array, poses: Poses) -> Frames:
    """Frames of the arm at rest under its loads. Raises CalibError where it finds no rest."""
    frames = model.state(values, poses).frames
    if not np.isfinite(frames.o).all():
        raise NoEquilibrium
    return frames


def reach(model: Model, values: Array, poses: Poses, goal: Goal) -> Reached:
    """Move every pose until its tip frame is the goal's, by Gauss-Newton steps on the arm at rest.

    Where the arm cannot, the square distance of the points from their places is least, orientation
    weighed by their spread; an arm of fewer than six joints puts their mean in place first.
    Directions in which the joints would have to swing far are left alone, and a joint that would pass
    its limit stays there. The arm's velocities are those of its displaced frames: how the deflection
    follows a step is left to the next one.

    Raises CalibError where the arm finds no equilibrium.
    """
    m, left = len(poses), np.arange(len(poses))
    found = Reached(
        poses.q.copy(),
        np.zeros(poses.q.shape, dtype=bool),
        np.zeros(m, dtype=np.int_),
        np.zeros(m, dtype=bool),
        np.full(m, np.inf),
    )
    for swing in _SWINGS:
        tried = _descend(model, values, poses.take(left), goal.take(left), swing)
        way = np.abs((tried.q - poses.q[left]) / _units(model.robot)).max(axis=1)
        good = tried.settled & (way <= _FARTHEST)
        better = good & (tried.missed < found.missed[left])
        for mine, theirs in zip(found, tried, strict=True):
            mine[left[better]] = theirs[better]
        # What went astray, stopped at a limit or gave up a direction may be nearer on a shorter way.
        left = left[~good | (tried.lost > 0) | tried.held.any(axis=1)]
        if not len(left):
            break
    return found


def _units(robot: Robot) -> Array:
    """Joints that slide count in units of the reach, so that both kinds weigh alike."""
    return np.where(robot.prismatic, robot.reach, 1.0)


def _descend(model: Model, values: Array, poses: Poses, goal: Goal, swing: float) -> Reached:
    """From the commands as given; ``swing`` is the most that a direction may ask of the joints."""
    robot, m, units = model.robot, len(poses), _units(model.robot)
    low, high = reachable(robot.ties, robot.limits).T
    low, high = np.minimum(low, poses.q), np.maximum(high, poses.q)
    q, held = poses.q.copy(), np.zeros(poses.q.shape, dtype=bool)
    rank, size, missed = np.full(m, -1), np.full(m, np.inf), np.zeros(m)
    for _ in range(_ROUNDS):
        now = np.flatnonzero(size > _SETTLED)
        if not len(now):
            break
        arm = tip_of(model, values, replace(poses.take(now), q=q[now]))
        free = ~held[now] * units
        J, error = _equations(robot, arm, goal.take(now))
        missed[now] = np.linalg.norm(error, axis=1)
        step, rank[now] = _step(J * free[:, None], error, swing, goal.length(robot), rank[now])
        asked = q[now] + step * free
        moved = np.clip(asked, low[now], high[now])
        size[now] = np.abs(moved - q[now]).max(axis=1)
        stopped = (moved != asked) & ~held[now]
        # Joints that follow go with those that lead them, from where they are.
        followed = q[now] + (moved - q[now]) @ robot.ties.matrix.T
        q[now] = np.where(robot.free, moved, followed)
        held[now] |= stopped
        renewed = now[stopped.any(axis=1)]
        rank[renewed], size[renewed] = -1, np.inf
    lost = np.minimum(6, robot.free.sum() - held.sum(axis=1)) - rank
    return Reached(q, held, lost, size < _STILL, missed)


def _equations(robot: Robot, arm: Frames, goal: Goal) -> tuple[Array, Array]:
    """How place and, times the tool's length, orientation move with free joints, and what they lack.

    Returns J (m, 6, n) and the error (m, 6), both of the mean of the points, base axes, m.
    """
    length, R = goal.length(robot), arm.R[:, goal.tip]
    there = arm.o[:, goal.tip] + rotate(R, goal.centre)
    wanted = goal.o + rotate(goal.R, goal.centre)
    turn = so3_log(goal.R @ np.swapaxes(R, -1, -2))
    slopes, turning = point_slopes(robot, arm, there, goal.tip), turns(robot, arm, goal.tip)
    J = np.concatenate([slopes, length * turning], axis=1) @ robot.ties.matrix
    return J, np.concatenate([wanted - there, length * turn], axis=1)


def _step(
    J: Array, error: Array, swing: float, length: float, rank: IntArray
) -> tuple[Array, IntArray]:
    """Least-squares step (m, n) in the directions that count, and how many these are.

    Directions count from the strongest to the first that asks for more than the swing.

    rank : ndarray of int, shape (m,), as judged at an earlier step, -1 to judge now
    """
    U, s, Vt = np.linalg.svd(J, full_matrices=False)
    along = rotate(np.swapaxes(U, -1, -2), error)
    least = np.maximum(np.abs(along), _WEAKEST * length) / swing
    judged = np.cumprod(s > least, axis=-1).sum(axis=-1)
    rank = np.where(rank < 0, judged, rank)
    kept = np.arange(s.shape[-1]) < rank[:, None]
    weights = np.where(kept, along / np.where(kept, s, 1.0), 0.0)
    return rotate(np.swapaxes(Vt, -1, -2), weights), rank
