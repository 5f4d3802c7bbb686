"""What an error may depend on, named as in the results: ``q:A3``, ``time``, ``load``, ..

Every variable is known of a pose before anything is measured, so that an error found in some poses
can be predicted at others.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field

import numpy as np

from calib.arm.kinematics import forward, link_origins
from calib.arm.robot import Robot
from calib.arm.statics import Payload, loads_of, transmitted
from calib.arrays import Array
from calib.poses import Poses


@dataclass(frozen=True, eq=False)
class Variable:
    """Something that an error may depend on; ``name`` as in the results."""

    name: str


@dataclass(frozen=True, eq=False)
class PoseVariable(Variable, ABC):
    """A function of the pose."""

    @abstractmethod
    def at(self, poses: Poses) -> Array:
        """Value at each pose, shape (m,), or (m, d) of several; NaN where it is not given."""


@dataclass(frozen=True, eq=False)
class Angle(PoseVariable):
    """The value of a joint as read, rad or m."""

    joint: int

    def at(self, poses: Poses) -> Array:
        return poses.q[:, self.joint]


@dataclass(frozen=True, eq=False)
class Posture(PoseVariable):
    """All joints at once, each in parts of its own spread over the data.

    spread : tuple of float, shape (n,), rad or m
    """

    spread: tuple[float, ...]

    def at(self, poses: Poses) -> Array:
        return np.asarray(poses.q / np.array(self.spread))


@dataclass(frozen=True, eq=False)
class Covariate(PoseVariable):
    """A column of the table: time [s], temperature [degC], approach, size of the move before."""

    field: str
    joint: int | None = None

    def at(self, poses: Poses) -> Array:
        values = getattr(poses, self.field)
        if values is None:
            return np.full(len(poses), np.nan)
        return np.asarray(values if self.joint is None else values[:, self.joint])


@dataclass(frozen=True, eq=False)
class Move(PoseVariable):
    """How far a joint went in the move before, with the sign of its last motion, rad or m.

    A servo that has not settled lacks a part of it; what asks for its size alone is even in it.
    """

    joint: int

    def at(self, poses: Poses) -> Array:
        return last_moves(poses)[:, self.joint]


def last_moves(poses: Poses) -> Array:
    """The last move of each joint with its sign, shape (m, n); without one where none is known."""
    if poses.motion is None:
        return np.full_like(poses.q, np.nan)
    return poses.motion if poses.approach is None else poses.approach * poses.motion


@dataclass(frozen=True, eq=False)
class Statics:
    """Wrenches in the nominal arm, which differ from the true ones by the size of the errors."""

    robot: Robot
    payload: Payload
    gravity: Array
    _last: dict[str, tuple[Poses, Array]] = field(default_factory=dict, repr=False)

    def wrench(self, poses: Poses) -> Array:
        """Force and moment that each frame transmits, shape (m, n + 2, 6), in its axes."""
        last = self._last.get("found")
        if last is None or last[0] is not poses:
            frames = forward(self.robot, poses.q)
            loads = loads_of(self.robot, poses, self.payload, self.gravity)
            carriers = link_origins(self.robot, frames, poses.q)
            last = self._last["found"] = (poses, transmitted(loads, frames, carriers).local)
        return last[1]


@dataclass(frozen=True, eq=False)
class Torque(PoseVariable):
    """What a frame transmits along some of its axes, N or N m."""

    statics: Statics
    frame: int
    axis: Array

    def at(self, poses: Poses) -> Array:
        return np.asarray(self.statics.wrench(poses)[:, self.frame] @ self.axis)


@dataclass(frozen=True, eq=False)
class Pull(PoseVariable):
    """Size of the force on the tip, N."""

    statics: Statics

    def at(self, poses: Poses) -> Array:
        return np.asarray(np.linalg.norm(self.statics.wrench(poses)[:, -1, :3], axis=-1))
