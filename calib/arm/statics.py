"""Wrenches that the loads send through the frames of the arm, and how they change with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.arm.kinematics import Frames, forward
from calib.arm.robot import Robot
from calib.arm.se3 import cross, rotate, skew
from calib.arrays import Array
from calib.poses import Poses


@dataclass(frozen=True)
class Payload:
    """A body carried at every pose: mass [kg] and centre of mass in the tip frame [m]."""

    mass: float = 0.0
    com: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Loads:
    """Everything that pulls on the arm, for m poses and the n + 2 frames.

    mass : ndarray, shape (..., m, n + 2), kg of the bodies that a frame carries (base counts nothing)
    mass_moment : ndarray, shape (..., m, n + 2, 3), kg m, mass times centre of mass, in the frame that
        carries it
    force, moment : ndarray, shape (..., m, 3), N and N m, at the tip frame's origin, base axes
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
    m = len(poses)
    mass = np.zeros((m, robot.dof + 2))
    moment = np.zeros((m, robot.dof + 2, 3))
    mass[:, 1:-1] = robot.masses
    moment[:, 1:-1] = robot.masses[:, None] * robot.coms
    mass[:, -1] = payload.mass + poses.load_mass
    moment[:, -1] = payload.mass * np.asarray(payload.com)
    moment[:, -1] += poses.load_mass[:, None] * poses.load_com
    pull = poses.wrench[:, :3]
    return Loads(mass, moment, pull, poses.wrench[:, 3:], pull, np.zeros((m, 3)), gravity)


@dataclass(frozen=True, eq=False)
class Transmitted:
    """Wrench that each frame passes on from all that lies beyond it.

    force : ndarray, shape (..., m, n + 2, 3), N, base axes
    moment : ndarray, shape (..., m, n + 2, 3), N m, base axes, about the frame's origin
    local : ndarray, shape (..., m, n + 2, 6), (force, moment) in the frame's own axes
    first_moment : ndarray, shape (..., m, n + 2, 3), kg m, of the masses beyond, base axes
    mass_beyond : ndarray, shape (..., m, n + 2), kg
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


def _from_tip(a: Array, axis: int) -> Array:
    """Cumulative sum from the tip towards the base."""
    return np.flip(np.cumsum(np.flip(a, axis), axis), axis)


def transmitted(loads: Loads, frames: Frames, carriers: Array) -> Transmitted:
    """Static Newton-Euler recursion from the tip to the base.

    carriers : ndarray, shape (..., m, n + 2, 3), origins of the frames that carry the bodies
    """
    moments = loads.mass[..., None] * carriers + rotate(frames.R_link, loads.mass_moment)
    mass_beyond = _from_tip(loads.mass, -1)
    first_moment = _from_tip(moments, -2)
    force = loads.force[..., None, :] + mass_beyond[..., None] * loads.gravity
    tip = frames.o[..., -1:, :]
    arm = first_moment - mass_beyond[..., None] * frames.o
    moment = loads.moment[..., None, :] + cross(tip - frames.o, loads.force[..., None, :])
    moment = moment + cross(arm, loads.gravity)
    if loads.lever.any():
        moment = moment + cross(_lever(loads, frames), loads.pull)[..., None, :]
    axes = np.swapaxes(frames.R, -1, -2)
    local = np.concatenate(
        [rotate(axes, np.broadcast_to(force, moment.shape)), rotate(axes, moment)], axis=-1
    )
    return Transmitted(force, moment, local, first_moment, mass_beyond)


def _lever(loads: Loads, frames: Frames) -> Array:
    """The lever of the measured force in base axes, shape (..., m, 3), m."""
    return rotate(frames.R[..., -1, :, :], loads.lever)


def rigid_change(loads: Loads, frames: Frames, wrench: Transmitted) -> tuple[Array, Array]:
    """How the transmitted wrench follows small motions of the arm, given as velocity fields (A, phi).

    Returns
    -------
    whole : ndarray, shape (..., m, n + 2, 6, 6): change of ``Transmitted.local`` when the frame and
        all beyond it move as one body. The loads keep their direction in base axes while the axes
        in which the wrench is read turn with the frame.
    beyond : ndarray, shape (..., m, n + 2, 3, 6): change of the moment [N m, base axes], about any
        point that rests, when all beyond the frame moves
    """
    g, f = skew(loads.gravity), skew(loads.force)[..., None, :, :]
    tip, mass = frames.o[..., -1:, :], wrench.mass_beyond[..., None, None]
    # (A + phi x c) x w = -[w]x A + [w]x [c]x phi, summed over the weights and the force at the tip.
    shift = -(mass * g + f)
    turn = g @ skew(wrench.first_moment) + f @ skew(tip)
    if loads.lever.any():
        turn = turn + (skew(loads.pull) @ skew(_lever(loads, frames)))[..., None, :, :]
    beyond = np.concatenate([np.broadcast_to(shift, turn.shape), turn], axis=-1)
    F, M = skew(wrench.force), skew(wrench.moment)
    own_shift = shift + F
    own_turn = turn - F @ skew(frames.o) + M
    axes = np.swapaxes(frames.R, -1, -2)
    whole = np.zeros((*turn.shape[:-2], 6, 6))
    whole[..., :3, 3:] = axes @ F
    whole[..., 3:, :3] = axes @ own_shift
    whole[..., 3:, 3:] = axes @ own_turn
    return whole, beyond


def wrench_with_load(robot: Robot, gravity: Array, poses: Poses) -> Array:
    """Wrench on the tip, the hung load included as at the nominal pose, shape (m, 6), N and N m.

    gravity : ndarray, shape (3,), m/s^2, in base axes
    """
    R_tip = forward(robot, poses.q).R[:, -1]
    force = poses.load_mass[:, None] * gravity
    moment = cross(rotate(R_tip, np.broadcast_to(poses.load_com, force.shape)), force)
    total: Array = poses.wrench + np.concatenate([force, moment], axis=-1)
    return total
