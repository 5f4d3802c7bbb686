"""Under what conditions the poses to come are read: as the data were, unless changed on purpose."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.arm.kinematics import forward
from calib.arm.robot import Robot
from calib.arm.se3 import cross, rotate, skew
from calib.arrays import Array
from calib.cell import Cell
from calib.poses import Poses, poses_at
from calib.poses.moves import moves

_FORCE, _MASS = 1.0, 0.1  # N, kg: loads closer than this are one
_MOST_LOADS = 3


@dataclass(frozen=True, eq=False)
class TipLoad:
    """What pulls on the tip at a reading.

    force : ndarray, shape (3,), N, base axes, at ``lever`` (3,), m, tip axes
    moment : ndarray, shape (3,), N m, base axes, beyond that of the force
    mass : float, kg, at ``com`` (3,), m, tip axes
    """

    force: Array
    lever: Array
    moment: Array
    mass: float
    com: Array

    @property
    def free(self) -> bool:
        """Whether nothing pulls."""
        return not (self.force.any() or self.moment.any() or self.mass)

    def mass_under(self, gravity: Array) -> float:
        """Mass that weighs as much, kg; gravity, shape (3,), m/s^2, standard where it is none."""
        pull = float(np.linalg.norm(gravity)) or 9.80665
        return self.mass + float(np.linalg.norm(self.force)) / pull

    def scaled(self, factor: float) -> TipLoad:
        """A load of the same kind, heavier or lighter."""
        return replace(
            self,
            force=self.force * factor,
            moment=self.moment * factor,
            mass=self.mass * factor,
        )

    def shifted(self, by: Array) -> TipLoad:
        """The same load at another point of the tip; by, shape (3,), m."""
        return replace(self, lever=self.lever + by, com=self.com + by)


@dataclass(frozen=True, eq=False)
class Conditions:
    """Conditions of further readings.

    loads : tuple of TipLoad, under each of which every configuration is read
    sides : tuple of float, +1 or -1, from which every joint comes, each a reading of its own; empty
        where the approach follows from the order of the poses
    time, pace : float, s, of the last reading and from one to the next; None where time is not known
    start : float, s, from which drift counts
    temperature : float, degC, or None
    station : int, the instrument's frame; stations : tuple of str
    last : ndarray, shape (dof,), where the arm stands; motion : ndarray, (dof,), usual size of a move,
        None where nothing is known of the moves
    """

    loads: tuple[TipLoad, ...]
    sides: tuple[float, ...]
    time: float | None
    pace: float
    start: float
    temperature: float | None
    station: int
    stations: tuple[str, ...]
    last: Array
    motion: Array | None

    @property
    def each(self) -> int:
        """Readings of one configuration."""
        return self.stay * max(1, len(self.sides))

    @property
    def stay(self) -> int:
        """Readings between two motions of the arm."""
        return len(self.loads)

    def in_order(self, robot: Robot, q: Array) -> Poses:
        """Readings of configurations (m, dof), one after the other; those of one stand together."""
        approach, motion = moves(np.concatenate([self.last[None], q]))
        time = self.pace * np.arange(1.0, len(q) * self.each + 1.0)
        return self._read(robot, q, approach[1:], motion[1:], time)

    def alike(self, robot: Robot, q: Array, side: float, count: int) -> Poses:
        """Readings of candidates, in turn as the first to the last of ``count`` configurations.

        q : ndarray, shape (m, dof), rad or m
        side : float, +1 or -1, from which every joint comes
        """
        approach = np.full_like(q, side)
        motion = np.zeros_like(q) if self.motion is None else np.broadcast_to(self.motion, q.shape)
        time = self.pace * (np.arange(float(len(q) * self.each)) % (count * self.each) + 1.0)
        return self._read(robot, q, approach, motion, time)

    def _read(self, robot: Robot, q: Array, approach: Array, motion: Array, time: Array) -> Poses:
        m, count = len(q), self.each
        loads = list(self.loads) * max(1, len(self.sides))
        R = forward(robot, q).R[:, -1]
        wrench = np.stack([_wrench(R, load) for load in loads], axis=1).reshape(-1, 6)
        approach = np.repeat(approach, count, axis=0)
        if self.sides:
            approach = np.sign(np.repeat(np.tile(self.sides, m), len(self.loads)))[:, None]
            approach = np.broadcast_to(approach, (m * count, q.shape[1]))
        com = next((load.com for load in loads if load.mass), np.zeros(3))
        known = self.motion is not None
        return poses_at(
            np.repeat(q, count, axis=0),
            wrench=wrench,
            load_mass=np.tile([load.mass for load in loads], m),
            load_com=com,
            time=None if self.time is None else self.time + time,
            start=self.start,
            temperature=None
            if self.temperature is None
            else np.full(m * count, float(self.temperature)),
            approach=approach if known else None,
            motion=np.repeat(motion, count, axis=0) if known else None,
            station=np.full(m * count, self.station),
            stations=self.stations,
        )


def _wrench(R: Array, load: TipLoad) -> Array:
    """Force and moment about the tip's origin in base axes, shape (m, 6)."""
    moment = cross(rotate(R, load.lever), load.force) + load.moment
    return np.column_stack([np.broadcast_to(load.force, moment.shape), moment])


def conditions_of(robot: Robot, poses: Poses) -> Conditions:
    """What goes on as it was: every load of the data, the pace, the last temperature and station."""
    order = np.arange(len(poses)) if poses.time is None else np.argsort(poses.time, kind="stable")
    end = int(order[-1])
    steps = np.zeros(0) if poses.time is None else np.diff(poses.time[order])
    steps = steps[steps > 0.0]
    known = poses.approach is not None or poses.motion is not None
    usual = np.zeros(robot.dof) if poses.motion is None else np.median(poses.motion, axis=0)
    return Conditions(
        loads=loads_of_data(robot, poses),
        sides=(),
        time=None if poses.time is None else float(poses.time[end]),
        pace=float(np.median(steps)) if len(steps) else 0.0,
        start=poses.start,
        temperature=None if poses.temperature is None else float(poses.temperature[end]),
        station=int(poses.station[end]),
        stations=poses.stations,
        last=poses.q[end],
        motion=usual if known else None,
    )


def loads_of_plan(cell: Cell) -> tuple[TipLoad, ...]:
    """The loads under which a cell's plan is read, the free state first."""
    nothing = np.zeros(3)
    free = TipLoad(nothing, nothing, nothing, 0.0, nothing)
    if cell.load is None:
        return (free,)
    return free, replace(free, mass=cell.load.mass, com=np.asarray(cell.load.com))


def loads_of_data(robot: Robot, poses: Poses) -> tuple[TipLoad, ...]:
    """The distinct loads under which the data were read, the free state first.

    Where they differ from reading to reading, as those of a force sensor do, their mean stands for
    all that are not free.
    """
    key = np.column_stack([poses.wrench[:, :3] / _FORCE, poses.load_mass / _MASS])
    kinds, group = np.unique(np.round(key), axis=0, return_inverse=True)
    group = group.reshape(-1)
    if len(kinds) > _MOST_LOADS:
        group = (np.abs(key) > 1.0).any(axis=1).astype(int)
    found = [_load(robot, poses.take(group == g)) for g in np.unique(group)]
    return tuple(sorted(found, key=lambda load: not load.free))


def _load(robot: Robot, poses: Poses) -> TipLoad:
    """Force, and where it acts: the point of the tip that explains the moments best."""
    force, moment = poses.wrench[:, :3], poses.wrench[:, 3:]
    R = forward(robot, poses.q).R[:, -1]
    arm = -skew(force) @ R
    lever = np.linalg.pinv(arm.reshape(-1, 3), rcond=1e-9) @ moment.ravel()
    rest: Array = (moment - rotate(arm, lever)).mean(axis=0)
    mean: Array = force.mean(axis=0)
    mass = float(poses.load_mass.mean())
    scale = float(np.abs(moment).max(initial=0.0))
    rest = np.where(np.abs(rest) > 1e-3 * scale, rest, 0.0)
    return TipLoad(mean, lever, rest, mass, poses.load_com if mass else np.zeros(3))
