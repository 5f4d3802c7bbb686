"""Unknown functions of known variables: what an error may depend on, and how.

Variables are named as in the results (``q:A3``, ``time``, ``load``, ..). Each is known of a pose before
anything is measured, so that an error found in some poses can be predicted at others.

A function of a variable v is a sum of basis functions; its coefficients are a priori normal with the
covariance ``exp(-distance / length)`` of an Ornstein-Uhlenbeck process, which takes a step as readily
as a slope. How large the function is, the data say.
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
class ErrorVariable:
    """Something that an error may depend on; ``name`` as in the results."""

    name: str


@dataclass(frozen=True, eq=False)
class PoseVariable(ErrorVariable, ABC):
    """A function of the pose."""

    @abstractmethod
    def at(self, poses: Poses) -> Array:
        """Value at each pose, shape (m,), or (m, d) of several; NaN where it is not given."""


@dataclass(frozen=True, eq=False)
class JointAngle(PoseVariable):
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
        if poses.motion is None:
            return np.full(len(poses), np.nan)
        moved = poses.motion[:, self.joint]
        return moved if poses.approach is None else poses.approach[:, self.joint] * moved


def pose_variables(robot: Robot, poses: Poses) -> dict[str, PoseVariable]:
    """What these poses say beside their loads, by name."""
    found: dict[str, PoseVariable] = {}
    if poses.clocked:
        found["time"] = Covariate("time", "clock")
    if poses.temperature is not None:
        found["temperature"] = Covariate("temperature", "temperature")
    for k, joint in enumerate(robot.joints):
        found[f"q:{joint}"] = JointAngle(f"q:{joint}", k)
        if poses.approach is not None:
            found[f"approach:{joint}"] = Covariate(f"approach:{joint}", "approach", k)
        if poses.motion is not None:
            found[f"motion:{joint}"] = Move(f"motion:{joint}", k)
    return found


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
            last = self._last["found"] = (
                poses,
                transmitted(self.robot, loads, frames, carriers).local,
            )
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
        force = self.statics.wrench(poses)[:, self.statics.robot.loaded, :3]
        return np.asarray(np.linalg.norm(force, axis=-1))


_LENGTH = 0.5  # of a variable's range, over which a function forgets its value
_APART = 2.0  # standard deviations of posture, likewise
_MOST_CENTRES = 30
_SAME = 1e-9


class Function(ABC):
    """A function of a variable with K coefficients."""

    @property
    @abstractmethod
    def labels(self) -> tuple[str, ...]:
        """A name for each coefficient: where it acts."""

    @abstractmethod
    def at(self, values: Array) -> Array:
        """Basis functions, shape (..., K), at values of the variable; zero where it is not given."""

    @property
    @abstractmethod
    def spread(self) -> Array:
        """Covariance of the coefficients a priori, shape (K, K), of unit amplitude."""


@dataclass(frozen=True, eq=False)
class Polyline(Function):
    """Values at knots, linear between them and constant beyond.

    knots : ndarray, shape (K,), ascending
    """

    knots: Array

    @property
    def labels(self) -> tuple[str, ...]:
        return tuple(f"{knot:.4g}" for knot in self.knots)

    def at(self, values: Array) -> Array:
        knots, given = self.knots, np.isfinite(values)
        inside = np.clip(np.where(given, values, knots[0]), knots[0], knots[-1])
        upper = np.clip(np.searchsorted(knots, inside, side="left"), 1, len(knots) - 1)
        share = (inside - knots[upper - 1]) / (knots[upper] - knots[upper - 1])
        weights = np.zeros((*np.shape(values), len(knots)))
        np.put_along_axis(weights, (upper - 1)[..., None], (1.0 - share)[..., None], axis=-1)
        np.put_along_axis(weights, upper[..., None], share[..., None], axis=-1)
        return np.asarray(weights * given[..., None])

    @property
    def spread(self) -> Array:
        length = _LENGTH * (self.knots[-1] - self.knots[0])
        return np.asarray(np.exp(-np.abs(self.knots[:, None] - self.knots) / length))


@dataclass(frozen=True, eq=False)
class Neighbours(Function):
    """Values at centres; between them the expectation, far from all of them zero.

    centres : ndarray, shape (K, d)
    """

    centres: Array

    @property
    def labels(self) -> tuple[str, ...]:
        return tuple(str(i + 1) for i in range(len(self.centres)))

    def at(self, values: Array) -> Array:
        return np.asarray(np.linalg.solve(self.spread, self._alike(values).T).T)

    @property
    def spread(self) -> Array:
        return self._alike(self.centres)

    def _alike(self, values: Array) -> Array:
        apart = np.linalg.norm(values[:, None, :] - self.centres, axis=-1)
        return np.asarray(np.exp(-apart / _APART))


def polyline(values: Array, most: int) -> Polyline | None:
    """A function of what a variable takes in the data, None where it does not vary.

    values : ndarray, shape (m,); most : int, knots
    """
    distinct = np.unique(np.round(values / max(np.abs(values).max(initial=0.0), _SAME), 9))
    if len(distinct) < 2:
        return None
    return Polyline(np.linspace(values.min(), values.max(), min(most, len(distinct))))


def neighbours(values: Array) -> Neighbours:
    """A function around the values (m, d) that lie farthest from each other, one after the other."""
    distinct = np.unique(np.round(values, 6), axis=0)
    chosen = [0]
    away = np.linalg.norm(distinct - distinct[0], axis=-1)
    while len(chosen) < min(_MOST_CENTRES, len(distinct)):
        chosen.append(int(np.argmax(away)))
        away = np.minimum(away, np.linalg.norm(distinct - distinct[chosen[-1]], axis=-1))
    return Neighbours(distinct[np.sort(chosen)])
