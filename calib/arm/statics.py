"""Wrenches that the loads send through the frames of the arm, and how they change with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.arm.kinematics import Frames, forward
from calib.arm.robot import Robot
from calib.arm.se3 import by_one, cross, double_cross, rotate, skew
from calib.arrays import Array, room
from calib.poses import Poses

STANDARD_GRAVITY = (0.0, 0.0, -9.80665)


@dataclass(frozen=True)
class Payload:
    """A body carried at every pose: mass [kg] and centre of mass in the tip frame [m].

    frame : int, of the tip that carries it; that of ``robot.tip`` without
    """

    mass: float = 0.0
    com: tuple[float, float, float] = (0.0, 0.0, 0.0)
    frame: int = -1


@dataclass(frozen=True, eq=False)
class Loads:
    """Everything that pulls on the arm, for m poses and F frames.

    mass : ndarray, shape (..., m, F), kg of the bodies that a frame carries (base counts nothing)
    mass_moment : ndarray, shape (..., m, F, 3), kg m, mass times centre of mass, in the frame that
        carries it
    force, moment : ndarray, shape (..., m, 3), N and N m, at the origin of the loaded tip, base axes
    pull : ndarray, shape (m, 3), N, the measured force, base axes
    lever : ndarray, shape (..., m, 3), m, tip axes: how far from the tip's origin ``pull`` acts beyond
        what the measured moment says
    gravity : ndarray, shape (3,), m/s^2, base axes

    The wrenches that follow are linear in all but ``pull`` and ``gravity``, which never vary.
    """

    mass: Array
    mass_moment: Array
    force: Array
    moment: Array
    pull: Array
    lever: Array
    gravity: Array

    @property
    def absent(self) -> bool:
        """Nothing pulls at any pose."""
        return not (self.force.any() or self.moment.any() or self.mass.any())

    def nothing(self) -> Loads:
        """No load at all beside the same measured force: what a change starts from."""
        varying = {name: np.zeros_like(getattr(self, name)) for name in _VARYING}
        return replace(self, **varying)

    def changed(self, changes: Sequence[Loads], values: Array) -> Loads:
        """The loads and ``values[..., i]`` times each change, shape (..., p) for p changes."""
        total = {name: getattr(self, name) for name in _VARYING}
        for i, change in enumerate(changes):
            for name in _VARYING:
                own = getattr(change, name)
                if own.any():
                    scale = values[..., i].reshape((*values.shape[:-1], *[1] * own.ndim))
                    total[name] = total[name] + scale * own
        return replace(self, **total)


_VARYING = ("mass", "mass_moment", "force", "moment", "lever")


def loads_of(robot: Robot, poses: Poses, payload: Payload, gravity: Array) -> Loads:
    """Gather wrench, payload, hung load and link weights of each pose.

    gravity : ndarray, shape (3,), m/s^2, base axes

    Raises nothing: a robot without link masses and poses without wrench give zeros.
    """
    m, count, joints = len(poses), robot.frame_count, slice(1, robot.dof + 1)
    mass, moment, wrench = room((m,), count), room((m,), count, 3), room((m,), 6)
    mass[...], moment[...], wrench[...] = 0.0, 0.0, poses.wrench
    mass[:, joints] = robot.masses
    moment[:, joints] = robot.masses[:, None] * robot.coms
    mass[:, payload.frame] = payload.mass
    moment[:, payload.frame] = payload.mass * np.asarray(payload.com)
    mass[:, robot.loaded] += poses.load_mass
    moment[:, robot.loaded] += poses.load_mass[:, None] * poses.load_com
    pull = wrench[:, :3]
    return Loads(mass, moment, pull, wrench[:, 3:], pull, np.zeros((m, 3)), gravity)


@dataclass(frozen=True, eq=False)
class Transmitted:
    """Wrench that each frame passes on from all that lies beyond it.

    force : ndarray, shape (..., m, F, 3), N, base axes
    moment : ndarray, shape (..., m, F, 3), N m, base axes, about the frame's origin
    local : ndarray, shape (..., m, F, 6), (force, moment) in the frame's own axes
    first_moment : ndarray, shape (..., m, F, 3), kg m, of the masses beyond, base axes
    mass_beyond : ndarray, shape (..., m, F), kg
    """

    force: Array
    moment: Array
    local: Array
    first_moment: Array
    mass_beyond: Array

    def with_extra(self, local: Array) -> Transmitted:
        """The same with a further wrench in local axes, as a spring beside a joint sends.

        local : ndarray, broadcast to the shape of ``self.local``
        """
        return replace(self, local=self.local + local)


def _from_tips(robot: Robot, a: Array, axis: int) -> Array:
    """Sum over all that each frame carries, and itself."""
    total = a.copy(order="K")
    frames = np.moveaxis(total, axis, 0)
    for k in reversed(range(1, len(frames))):
        frames[robot.parents[k - 1]] += frames[k]
    return total


def transmitted(robot: Robot, loads: Loads, frames: Frames, carriers: Array) -> Transmitted:
    """Static Newton-Euler recursion from the tips to the base.

    carriers : ndarray, shape (..., m, F, 3), origins of the frames that carry the bodies
    """
    moments = loads.mass[..., None] * carriers + rotate(frames.R_link, loads.mass_moment)
    mass_beyond = _from_tips(robot, loads.mass, -1)
    first_moment = _from_tips(robot, moments, -2)
    weight = by_one(mass_beyond[..., None], loads.gravity[None])
    force = at_carriers(robot, loads.force[..., None, :]) + weight
    tip = frames.o[..., robot.loaded, None, :]
    arm = first_moment - mass_beyond[..., None] * frames.o
    moment = loads.moment[..., None, :] + cross(tip - frames.o, loads.force[..., None, :])
    if loads.lever.any():
        moment = moment + cross(_lever(robot, loads, frames), loads.pull)[..., None, :]
    moment = at_carriers(robot, moment) + cross(arm, loads.gravity)
    axes = np.swapaxes(frames.R, -1, -2)
    local = np.concatenate(
        [rotate(axes, np.broadcast_to(force, moment.shape)), rotate(axes, moment)], axis=-1
    )
    return Transmitted(force, moment, local, first_moment, mass_beyond)


def _lever(robot: Robot, loads: Loads, frames: Frames) -> Array:
    """The lever of the measured force in base axes, shape (..., m, 3), m."""
    return rotate(frames.R[..., robot.loaded, :, :], loads.lever)


def at_carriers(robot: Robot, of_tip: Array) -> Array:
    """What the load at a tip does to frames (..., F or 1, k): nothing to those that carry it not."""
    return of_tip * robot.carries[:, robot.loaded, None] if robot.branched else of_tip


def change_beyond(robot: Robot, loads: Loads, frames: Frames, wrench: Transmitted) -> Array:
    """How moments follow a small motion, a velocity field (A, phi), of all beyond each frame.

    Returns ndarray, shape (..., m, F, 3, 6), N m, base axes, about any point that rests. The loads
    keep their direction: (A + phi x c) x w = -[w]x A + [w]x [c]x phi, summed over the weights and the
    force at the tip.
    """
    pull = double_cross(loads.force[..., None, :], frames.o[..., robot.loaded, None, :])
    if loads.lever.any():
        lever = _lever(robot, loads, frames)
        pull = pull + double_cross(loads.pull, lever)[..., None, :, :]
    carrying = robot.carries[:, robot.loaded, None, None] if robot.branched else True
    turn = double_cross(loads.gravity, wrench.first_moment) + pull * carrying
    return np.concatenate([np.broadcast_to(-skew(wrench.force), turn.shape), turn], axis=-1)


def wrench_with_load(robot: Robot, gravity: Array, poses: Poses) -> Array:
    """Wrench on the loaded tip, the hung load included as at the nominal pose, shape (m, 6), N and N m.

    gravity : ndarray, shape (3,), m/s^2, in base axes
    """
    R_tip = forward(robot, poses.q).R[:, robot.loaded]
    force = poses.load_mass[:, None] * gravity
    moment = cross(rotate(R_tip, np.broadcast_to(poses.load_com, force.shape)), force)
    total: Array = poses.wrench + np.concatenate([force, moment], axis=-1)
    return total
