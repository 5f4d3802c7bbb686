"""Motions to choose from: Fourier series of all joints, drawn within the limits of the robot.

A series begins and ends at rest, without a jump of the acceleration (Swevers et al., IEEE Transactions
on Robotics and Automation 13(5), 1997).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.arm.robot import Robot
from calib.arm.statics import Payload
from calib.arrays import Array
from calib.cell import Cell
from calib.errors import CalibError
from calib.motion.filtering import SLOW
from calib.motion.gram import carried
from calib.motion.motions import Run
from calib.motion.regressor import nominal_inertials, regressor
from doe.constraints import broken_at

RATE = 100.0  # Hz, of what is commanded
_HARMONICS = 5
_PERIODS = (1, 2, 4)  # of a motion in its duration: slow and fast ones
_SPEED, _ACCELERATION = 1.0, 4.0  # rad/s or m/s and these a second, where the robot states none
_OF_LIMITS = 0.9  # share of each limit that a motion uses at most
_LEAST = 0.3  # and at least, of the one that it meets first
_FRICTION = 0.2  # of the torque's RMS, as drives have
_LOOKED_AT = 80  # samples of a motion at which torques and obstacles are checked


@dataclass(frozen=True, eq=False)
class Motion:
    """A Fourier series.

    centre : ndarray, shape (n,), rad or m; a, b : ndarray, shape (K, n), of sine and cosine, the same
    frequency : rad/s, of the first harmonic; lasts : s; payload : what is carried beside the cell's
    """

    centre: Array
    a: Array
    b: Array
    frequency: float
    lasts: float
    payload: Payload

    def at(self, time: Array) -> tuple[Array, Array, Array]:
        """Joint values, speeds and accelerations, each of shape (m, n)."""
        w = self.frequency * np.arange(1, len(self.a) + 1)
        sin, cos = np.sin(time[:, None] * w), np.cos(time[:, None] * w)
        q = self.centre + sin @ self.a + cos @ self.b
        v = (cos * w) @ self.a - (sin * w) @ self.b
        return q, v, -(sin * w**2) @ self.a - (cos * w**2) @ self.b

    @property
    def time(self) -> Array:
        """Stamps of what is commanded, shape (m,), s."""
        return np.arange(0.0, self.lasts + 0.5 / RATE, 1.0 / RATE)

    def run(self, cell: Cell) -> Run:
        """The motion as a run, at half the rate, with torques of links and usual dry friction."""
        time = self.time[::2]
        q, v, a = self.at(time)
        torque = self.torque(cell, q, v, a)
        friction = _FRICTION * np.sqrt((torque**2).mean(axis=0)) * np.tanh(v / SLOW)
        return Run("", time, q, torque + friction)

    def torque(self, cell: Cell, q: Array, v: Array, a: Array) -> Array:
        """Torque of the links as the robot's file has them, with what is carried, shape (m, n)."""
        links = carried(cell.robot, nominal_inertials(cell.robot), self.payload).ravel()
        return np.asarray(regressor(cell.robot, q, v, a, cell.gravity) @ links)

    def scaled(self, factors: Array) -> Motion:
        """With other amplitudes, factors of shape (n,)."""
        return replace(self, a=self.a * factors, b=self.b * factors)


def drawn(
    cell: Cell, count: int, lasts: float, rng: np.random.Generator
) -> tuple[list[Motion], dict[str, int], list[str]]:
    """Motions within the limits, what removed others, and what was taken for granted.

    With a ``[load]`` in the cell every second one carries it. Raises CalibError where none is left.
    """
    robot, granted = cell.robot, []
    speeds, accelerations = robot.speeds, robot.accelerations
    if speeds is None or not np.isfinite(speeds).all():
        granted.append(f"joint speeds up to {_SPEED:g} rad/s or m/s where none is stated")
    if accelerations is None or not np.isfinite(accelerations).all():
        granted.append(
            f"accelerations up to {_ACCELERATION:g} rad/s^2 or m/s^2 where none is stated"
        )
    limits = (_or(speeds, _SPEED, robot.dof), _or(accelerations, _ACCELERATION, robot.dof))
    kept, removed = list[Motion](), dict[str, int]()
    for k in range(count):
        motion = _one(cell, lasts, limits, rng, loaded=bool(k % 2))
        broken = _broken(cell, motion)
        if broken:
            removed[broken] = removed.get(broken, 0) + 1
        else:
            kept.append(motion)
    if not kept:
        raise CalibError(f"none of {count} motions keeps the limits; the first fault is {broken}")
    return kept, removed, granted


def _or(values: Array | None, fallback: float, n: int) -> Array:
    known = np.full(n, np.nan) if values is None else values
    return np.where(np.isfinite(known) & (known > 0.0), known, fallback)


def _one(
    cell: Cell,
    lasts: float,
    limits: tuple[Array, Array],
    rng: np.random.Generator,
    *,
    loaded: bool,
) -> Motion:
    """A motion whose joints each meet one of their limits, or a drawn share of it."""
    robot = cell.robot
    low, high = robot.sample_limits().T
    # Beyond a turn and a half each way nothing new is seen.
    low, high = np.maximum(low, -1.5 * np.pi), np.minimum(high, 1.5 * np.pi)
    k = np.arange(1, _HARMONICS + 1)[:, None]
    a, b = rng.normal(size=(2, _HARMONICS, robot.dof)) / k
    a, b = np.array([a, b]) @ _led(robot)
    a -= k * (k * a).sum(axis=0) / (k**2).sum()  # at rest at both ends
    b -= k**2 * (k**2 * b).sum(axis=0) / (k**4).sum()  # and not accelerated
    centre = robot.tied(rng.uniform(0.7 * low + 0.3 * high, 0.3 * low + 0.7 * high)[None])[0]
    frequency = 2.0 * np.pi * float(rng.choice(_PERIODS)) / lasts
    plain = Motion(centre, a, b, frequency, lasts, _payload(cell, loaded))
    q, v, acceleration = plain.at(plain.time)
    room = np.minimum(high - centre, centre - low) / np.abs(q - centre).max(axis=0)
    most = np.min(
        [room, limits[0] / np.abs(v).max(axis=0), limits[1] / np.abs(acceleration).max(axis=0)],
        axis=0,
    )
    return plain.scaled(most * rng.uniform(_LEAST, _OF_LIMITS) * rng.uniform(0.5, 1.0, robot.dof))


def _led(robot: Robot) -> Array:
    """How joints follow others, shape (n, n)."""
    return np.asarray(robot.tied(np.eye(robot.dof)) - robot.tied(np.zeros((1, robot.dof))))


def _payload(cell: Cell, loaded: bool) -> Payload:
    """What the cell carries at every pose, and the load beside it."""
    own, load = cell.payload, cell.load
    if not loaded or load is None:
        return own
    mass = own.mass + load.mass
    com = (own.mass * np.array(own.com) + load.mass * np.array(load.com)) / mass
    return Payload(mass, (float(com[0]), float(com[1]), float(com[2])), own.frame)


def _broken(cell: Cell, motion: Motion) -> str:
    """What a motion breaks, "" where nothing."""
    robot = cell.robot
    time = np.linspace(0.0, motion.lasts, _LOOKED_AT)
    q, v, a = motion.at(time)
    torque = np.abs(motion.torque(cell, q, v, a)).max(axis=0)
    if (torque > _OF_LIMITS * np.where(np.isfinite(robot.efforts), robot.efforts, np.inf)).any():
        return "joint_torque"
    met = broken_at(cell, q)
    return str(next((name for name in met if name), ""))
