"""Joint values that are brought to where some equations hold, by Newton's steps of least length.

Even starts stay spread over all configurations that satisfy the equations, within the joint limits. The
arm is the nominal one.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from calib.arm.kinematics import Frames, forward
from calib.arm.robot import Robot
from calib.arm.se3 import rotate
from calib.arrays import Array, IntArray, Mask

Equations: TypeAlias = Callable[[IntArray, Frames], tuple[Array, Array]]
"""Of some starts (n,) and the arm there: what is missed (n, r), m, and its derivatives (n, r, dof)."""

_THERE = 1e-10  # m
_STEPS = 30
_LONGEST = 0.5  # rad, or of the reach, in one step
_NOTHING = 1e-12  # beside the largest lever: damping near singular poses


def approached(robot: Robot, q: Array, free: Mask, missed: Equations, reluctant: float) -> Array:
    """Where the steps from joint values (m, dof) end.

    free : ndarray of bool, shape (dof,), joints that may move
    reluctant : damping, of the largest lever: more where the equations are more than the joints
    """
    q = q.copy()
    low, high = robot.sample_limits().T
    units = np.where(robot.prismatic, robot.reach, 1.0)
    now = np.arange(len(q))
    for _ in range(_STEPS):
        off, J = missed(now, forward(robot, q[now]))
        size = np.linalg.norm(off, axis=1)
        left = size > _THERE
        now, off = now[left], off[left]
        if not len(now):
            break
        J = J[left] @ robot.ties.matrix * (units * free)
        step = _least(J, -off, reluctant) * units
        # A joint at its limit that is pushed beyond it stays, and the others go the way.
        stuck = ((q[now] <= low) & (step < 0.0)) | ((q[now] >= high) & (step > 0.0))
        held = stuck.any(axis=1)
        step[held] = _least((J * ~stuck[:, None, :])[held], -off[held], reluctant) * units
        size = np.linalg.norm(step / units, axis=1, keepdims=True)
        step *= np.minimum(1.0, _LONGEST / np.maximum(size, 1e-300))
        q[now] = robot.tied(np.clip(q[now] + step, low, high))
    return q


def _least(J: Array, wanted: Array, reluctant: float) -> Array:
    """The least steps (m, n) with ``J step = wanted``, (m, r)."""
    Jt = np.swapaxes(J, -1, -2)
    A = J @ Jt
    size = np.trace(A, axis1=-2, axis2=-1)[:, None, None] + _NOTHING
    solved = np.linalg.solve(A + reluctant * size * np.eye(A.shape[-1]), wanted[..., None])
    return np.asarray((Jt @ solved)[..., 0])


def turns(robot: Robot, frames: Frames, frame: int = -1) -> Array:
    """How a tip turns with the joints, shape (m, 3, n), base axes.

    frame : of the tip; that of ``robot.tip`` without
    """
    axes = rotate(frames.R[:, 1 : robot.dof + 1], robot.axes)
    turning = ~robot.prismatic & robot.moving(frame)
    return np.swapaxes(np.where(turning[:, None], axes, 0.0), -1, -2)
