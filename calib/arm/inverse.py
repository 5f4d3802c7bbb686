"""Inverse kinematics of the nominal robot: joint values that put its tip where it is wanted.

Damped Gauss-Newton steps (Levenberg, Marquardt) from many starts, all targets and starts in one batch,
for chains of any kind. Joints that turn are free on the way; whole turns bring them into their limits.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arm.approach import turns
from calib.arm.kinematics import Frames, forward, point_slopes
from calib.arm.robot import Robot
from calib.arm.se3 import so3_log
from calib.arrays import Array, Mask

_STARTS = 48
_STEPS = 80
_THERE = 1e-10  # of the reach, and rad: what is left where a target is met
_SAME = 1e-5  # rad or of the reach: solutions closer than this are one
_TURN = 2.0 * np.pi


@dataclass(frozen=True, eq=False)
class Solutions:
    """What was found for one target.

    q : ndarray, shape (k, n), rad or m, distinct solutions, whole turns aside; none out of reach
    short, turned : float, m and rad, by how much the best start missed place and orientation
    """

    q: Array
    short: float
    turned: float


def solutions(robot: Robot, R: Array, o: Array) -> list[Solutions]:
    """What many starts find for tips R (m, 3, 3), o (m, 3) [m] in base axes, limits aside."""
    q = np.tile(robot.sobol(_STARTS), (len(o), 1))
    q, e = _descend(robot, q, np.repeat(R, _STARTS, axis=0), np.repeat(o, _STARTS, axis=0))
    q, e = q.reshape(len(o), _STARTS, -1), e.reshape(len(o), _STARTS, 6)
    return [_found(robot, *own) for own in zip(q, e, strict=True)]


def _found(robot: Robot, q: Array, e: Array) -> Solutions:
    sizes = np.linalg.norm(e, axis=1)
    best = e[int(sizes.argmin())]
    whole = ~robot.prismatic & ~robot.coupled  # a whole turn of these changes nothing
    distinct: list[Array] = []
    for one in q[sizes < _THERE]:
        turned = one / np.where(robot.prismatic, robot.reach, 1.0)
        turned = np.where(whole, np.angle(np.exp(1j * one)), turned)
        off = [turned - other for other in distinct]
        off = [np.where(whole, np.angle(np.exp(1j * d)), d) for d in off]
        if all(np.abs(d).max() > _SAME for d in off):
            distinct.append(turned)
    kept = np.array(distinct).reshape(-1, robot.dof) * np.where(robot.prismatic, robot.reach, 1.0)
    place, turn = np.linalg.norm(best[:3]) * robot.reach, np.linalg.norm(best[3:])
    return Solutions(kept, float(place), float(turn))


def nearest(robot: Robot, q: Array, reference: Array) -> tuple[Array | None, Array]:
    """The solution within the limits nearest to a reference, and by how much each passes them.

    q : ndarray, shape (k, n), solutions; reference : ndarray, shape (n,); both rad or m
    Returns None where all are outside; and the excess (k, n), rad or m.
    """
    low, high = robot.limits.T
    whole = ~robot.prismatic & ~robot.coupled
    turns = np.where(whole, np.round((reference - q) / _TURN), 0.0)
    near = q + turns * _TURN
    near = near + np.where((near > high) & whole, -_TURN, 0.0) * np.ceil(
        np.where(np.isfinite(high), np.maximum(near - high, 0.0), 0.0) / _TURN
    )
    near = near + np.where((near < low) & whole, _TURN, 0.0) * np.ceil(
        np.where(np.isfinite(low), np.maximum(low - near, 0.0), 0.0) / _TURN
    )
    excess = np.maximum(np.maximum(low - near, near - high), 0.0)
    inside = np.flatnonzero((excess < _SAME).all(axis=1))
    if not len(inside):
        return None, excess
    scale = np.where(robot.prismatic, robot.reach, 1.0)
    way = np.linalg.norm((near[inside] - reference) / scale, axis=1)
    return robot.tied(np.clip(near[inside[int(way.argmin())]], low, high)), excess


def _descend(robot: Robot, q: Array, R: Array, o: Array) -> tuple[Array, Array]:
    """Where starts q (N, n) end, and what is left there (N, 6), place in units of the reach."""
    units = np.where(robot.prismatic, robot.reach, 1.0)
    q, damping = q.copy(), np.full(len(q), 1e-2)
    arm = forward(robot, q)
    e = _missing(robot, arm, R, o)
    for _ in range(_STEPS):
        now = np.flatnonzero((np.linalg.norm(e, axis=1) > _THERE) & (damping < 1e8))
        if not len(now):
            break
        J = _slopes(robot, forward(robot, q[now])) * units
        Jt = np.swapaxes(J, -1, -2)
        A = Jt @ J + damping[now, None, None] * np.eye(robot.dof)
        step = np.linalg.solve(A, Jt @ e[now][..., None])[..., 0] * units
        tried = robot.tied(q[now] + step)
        left = _missing(robot, forward(robot, tried), R[now], o[now])
        better: Mask = np.linalg.norm(left, axis=1) < np.linalg.norm(e[now], axis=1)
        q[now[better]], e[now[better]] = tried[better], left[better]
        damping[now] *= np.where(better, 0.1, 8.0)
        damping[now] = np.maximum(damping[now], 1e-15)
    return q, e


def _missing(robot: Robot, arm: Frames, R: Array, o: Array) -> Array:
    turn = so3_log(R @ np.swapaxes(arm.R[:, -1], -1, -2))
    return np.concatenate([(o - arm.o[:, -1]) / robot.reach, turn], axis=1)


def _slopes(robot: Robot, arm: Frames) -> Array:
    """How the tip's place [reach] and orientation move with the joints that are free, (N, 6, n)."""
    place = point_slopes(robot, arm, arm.o[:, -1]) / robot.reach
    return np.concatenate([place, turns(robot, arm)], axis=-2) @ robot.ties.matrix
