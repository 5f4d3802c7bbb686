"""The torques of a rigid tree, linear in ten inertial parameters of each link.

Of a link with mass m, first moment ``m c`` and inertia I about the origin of its frame, whose angular
velocity is w, angular acceleration dw, and origin's acceleration less gravity is a,

    force  = m a + dw x (m c) + w x (w x (m c))
    moment = (m c) x a + I dw + w x (I w)

about that origin (Khalil and Dombre, Modeling, Identification and Control of Robots, 2002, chapter 9).
What a joint transmits is the sum over all links that it carries.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from calib.arm.kinematics import forward, link_origins
from calib.arm.robot import Robot
from calib.arm.se3 import skew, steiner
from calib.arrays import Array

PER_LINK = 10
"""Inertial parameters of a link: m, m c (3), Ixx, Ixy, Ixz, Iyy, Iyz, Izz."""
TENSOR = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
"""Where the last six stand in the inertia."""
_CHUNK = 20_000  # rows at a time


def nominal_inertials(robot: Robot) -> Array:
    """Inertial parameters of the robot's file, shape (n, 10), SI."""
    inertias = np.zeros((robot.dof, 3, 3)) if robot.inertias is None else robot.inertias
    about = inertias + robot.masses[:, None, None] * steiner(robot.coms)
    tensor = np.stack([about[:, i, j] for i, j in TENSOR], axis=1)
    return np.concatenate(
        [robot.masses[:, None], robot.masses[:, None] * robot.coms, tensor], axis=1
    )


def regressor(robot: Robot, q: Array, v: Array, a: Array, gravity: Array) -> Array:
    """``Y`` with torque ``Y @ phi``, shape (m, n, 10 n), at joint values, speeds and accelerations.

    q, v, a : ndarray, shape (m, n); gravity : ndarray, shape (3,), m/s^2, base axes
    """
    n = robot.dof
    Y = np.zeros((len(q), n, n, PER_LINK))
    for begin in range(0, len(q), _CHUNK):
        own = slice(begin, begin + _CHUNK)
        _fill(Y[own], robot, q[own], v[own], a[own], gravity)
    return Y.reshape(len(q), n, n * PER_LINK)


def _fill(Y: Array, robot: Robot, q: Array, v: Array, a: Array, gravity: Array) -> None:
    """Torques (m, n, n, 10) of unit parameters of every link."""
    frames = forward(robot, q)
    R, o = frames.R_link, link_origins(robot, frames, q)
    axes = (frames.R[:, 1 : robot.dof + 1] @ robot.axes[:, :, None])[..., 0]
    for k, (w, dw, acceleration) in enumerate(_moved(robot, o, axes, v, a, gravity)):
        force, moment = _unit_wrenches(R[:, k + 1], w, dw, acceleration)
        for j in np.flatnonzero(robot.moving(k + 1)).tolist():
            arm = np.cross(axes[:, j], o[:, k + 1] - o[:, j + 1])
            if robot.prismatic[j]:
                Y[:, j, k] = np.einsum("mi,mip->mp", axes[:, j], force)
            else:
                Y[:, j, k] = np.einsum("mi,mip->mp", axes[:, j], moment)
                Y[:, j, k] += np.einsum("mi,mip->mp", arm, force)


def _moved(
    robot: Robot, o: Array, axes: Array, v: Array, a: Array, gravity: Array
) -> Iterator[tuple[Array, Array, Array]]:
    """Angular velocity, angular acceleration and acceleration of the origin of each link, base axes."""
    rest = np.zeros((len(v), 3))
    done = [(rest, rest, rest - gravity)]
    for k, parent in enumerate(robot.parents[: robot.dof]):
        w, dw, acceleration = done[parent]
        arm, axis = o[:, k + 1] - o[:, parent], axes[:, k]
        speed, change = axis * v[:, k, None], axis * a[:, k, None]
        acceleration = acceleration + np.cross(dw, arm) + np.cross(w, np.cross(w, arm))
        if robot.prismatic[k]:
            acceleration = acceleration + change + 2.0 * np.cross(w, speed)
        else:
            w, dw = w + speed, dw + change + np.cross(w, speed)
        done.append((w, dw, acceleration))
        yield done[-1]


def _unit_wrenches(R: Array, w: Array, dw: Array, acceleration: Array) -> tuple[Array, Array]:
    """Force and moment (m, 3, 10) about a link's origin, base axes, of each parameter being one.

    R : ndarray, shape (m, 3, 3), the axes of the link
    """
    m = len(w)
    turning = skew(dw) + skew(w) @ skew(w)
    force, moment = np.zeros((2, m, 3, PER_LINK))
    force[..., 0] = acceleration
    force[..., 1:4] = turning @ R
    moment[..., 1:4] = -skew(acceleration) @ R
    to_link = np.swapaxes(R, -1, -2)
    speed, change = ((to_link @ own[..., None])[..., 0] for own in (w, dw))
    for p, (i, j) in enumerate(TENSOR):
        unit = np.zeros((3, 3))
        unit[i, j] = unit[j, i] = 1.0
        local = change @ unit + np.cross(speed, speed @ unit)
        moment[..., 4 + p] = (R @ local[..., None])[..., 0]
    return force, moment
