"""What the drives can hold."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arm.se3 import skew
from calib.arrays import Array, Mask
from calib.cell import Cell, Load
from doe.constraints.protocol import Constraint
from doe.constraints.scene import Scene, turned


@dataclass(frozen=True, eq=False)
class JointTorque(Constraint):
    """Weights of links and payload, with and without the load, within the efforts of the drives.

    efforts : ndarray, shape (dof,), N m, or N where a joint slides; infinite where none is given
    """

    efforts: Array
    name: str = "joint_torque"

    def allows(self, scene: Scene) -> Mask:
        readings = static_torques(scene)
        return np.asarray((np.abs(readings) <= self.efforts).all(axis=(0, 2)))


def joint_torque(cell: Cell) -> JointTorque | None:
    """The efforts of the cell's robot; None where none is given or nothing weighs on it."""
    robot, load = cell.robot, cell.load
    weighs = robot.masses.any() or cell.payload.mass or (load is not None and load.mass)
    efforts = np.where(np.isnan(robot.efforts), np.inf, robot.efforts)
    if not (weighs and cell.gravity.any() and np.isfinite(efforts).any()):
        return None
    return JointTorque(efforts)


def static_torques(scene: Scene) -> Array:
    """Torque [N m] or force [N] along each joint, shape (2, n, dof): free, and with the load.

    What :func:`calib.arm.statics.transmitted` gives in all six components, at several times the cost.
    """
    cell, robot = scene.cell, scene.cell.robot
    load = cell.load or Load(0.0, (0.0, 0.0, 0.0))
    hung = load.mass * scene.placed(robot.tip_frame, load.com)
    mass = cell.payload.mass
    moment = mass * scene.placed(robot.tip_frame, cell.payload.com)
    torques = np.empty((robot.dof, 2, len(scene)))
    for k in reversed(range(robot.dof)):
        if robot.masses[k]:
            mass += robot.masses[k]
            moment += robot.masses[k] * scene.placed(k + 1, robot.coms[k])
        axis, o = turned(scene.frames.R[:, k + 1], robot.axes[k]), scene.frames.o[:, k + 1]
        slides = bool(robot.prismatic[k])
        free = _along(axis, o, slides, mass, moment, cell.gravity)
        torques[k] = free, free + _along(axis, o, slides, load.mass, hung, cell.gravity)
    return np.moveaxis(torques, 0, -1)


def _along(
    axis: Array, o: Array, slides: bool, mass: float, moment: Array, gravity: Array
) -> Array:
    """What a weight of first moment (n, 3) in kg m adds along axes (n, 3) through o, shape (n,)."""
    if slides:
        return np.asarray(mass * (axis @ gravity))
    # a . ((c - o) x m g), the mass m at c.
    return np.asarray(np.einsum("ni,ni->n", moment - mass * o, axis @ skew(gravity).T))
