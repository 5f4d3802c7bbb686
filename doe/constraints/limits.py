"""What the arm can do where it stands: joint limits, a load that hangs, drives that hold."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arm.statics import loads_of, transmitted
from calib.arrays import Array, Mask
from calib.cell import Cell, Load
from calib.poses import poses_at
from doe.constraints.scene import Constraint, Scene

_SLACK = 1e-9  # rad or m; a limit that is converted from degrees is still reached


@dataclass(frozen=True, eq=False)
class JointLimits(Constraint):
    """Every joint within its limits, ndarray of shape (dof, 2), rad or m."""

    limits: Array
    name: str = "joint_limits"

    def allows(self, scene: Scene) -> Mask:
        low, high = self.limits.T
        return np.asarray(((scene.q >= low - _SLACK) & (scene.q <= high + _SLACK)).all(axis=1))


def joint_limits(cell: Cell) -> JointLimits | None:
    """The limits of the cell's robot; None where all its joints turn without end."""
    return JointLimits(cell.robot.limits) if np.isfinite(cell.robot.limits).any() else None


@dataclass(frozen=True, eq=False)
class HangingLoad(Constraint):
    """The x axis of the tip that is loaded leaves the horizontal by no more than the load allows.

    down : ndarray, shape (3,), unit vector of gravity in base axes; max_tilt : float, rad
    """

    down: Array
    max_tilt: float
    name: str = "hanging_load"

    def allows(self, scene: Scene) -> Mask:
        sine = np.abs(scene.frames.R[:, scene.cell.robot.loaded, :, 0] @ self.down)
        return np.asarray(sine <= np.sin(self.max_tilt) + _SLACK)


def hanging_load(cell: Cell) -> HangingLoad | None:
    """The limit of the cell's load; None where nothing hangs or every tilt will do."""
    pull = float(np.linalg.norm(cell.gravity))
    if cell.load is None or cell.load.max_tilt >= np.pi / 2 or not pull:
        return None
    return HangingLoad(cell.gravity / pull, cell.load.max_tilt)


@dataclass(frozen=True, eq=False)
class JointTorque(Constraint):
    """Weights of links and payload, with and without the load, within the efforts of the drives.

    efforts : ndarray, shape (dof,), N m, or N where a joint slides; infinite where none is given
    """

    efforts: Array
    name: str = "joint_torque"

    def allows(self, scene: Scene) -> Mask:
        return np.asarray((np.abs(static_torques(scene)) <= self.efforts).all(axis=(0, 2)))


def joint_torque(cell: Cell) -> JointTorque | None:
    """The efforts of the cell's robot; None where none is given or nothing weighs on it."""
    robot, load = cell.robot, cell.load
    weighs = robot.masses.any() or cell.payload.mass or (load is not None and load.mass)
    efforts = np.where(np.isnan(robot.efforts), np.inf, robot.efforts)
    acts = weighs and cell.gravity.any() and np.isfinite(efforts).any()
    return JointTorque(efforts) if acts else None


def static_torques(scene: Scene) -> Array:
    """Torque [N m] or force [N] along each joint, shape (2, n, dof): free, and with the load."""
    robot, load = scene.cell.robot, scene.cell.load or Load(0.0, (0.0, 0.0, 0.0))
    torques = []
    for mass in (0.0, load.mass):
        poses = poses_at(scene.q, load_mass=np.full(len(scene), mass), load_com=np.array(load.com))
        loads = loads_of(robot, poses, scene.cell.payload, scene.cell.gravity)
        wrench = transmitted(robot, loads, scene.frames, scene.origins).local[:, 1 : robot.dof + 1]
        along = np.where(robot.prismatic[:, None], wrench[..., :3], wrench[..., 3:])
        torques.append(np.einsum("nki,ki->nk", along, robot.axes))
    # By virtual work a drive holds its share of what couplings move, too.
    return np.array(torques) @ robot.driven if robot.couplings else np.array(torques)
