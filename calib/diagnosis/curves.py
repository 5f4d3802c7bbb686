"""Causes without a name: a place that is off by an unknown function of one variable.

The function is a sum of hats over the variable's range. In the contest beside the catalogue such a
block locates what the catalogue cannot explain, and its coefficients are the curve of the error.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from calib.effects.drive import along_axis, error_unit
from calib.effects.protocol import Context, Parameter, State, Strand, TwistEffect, joint_index
from calib.errors import EffectCannotAct
from calib.se3 import Array

_KNOTS = 8
_SAME = 1e-9


class Variable(ABC):
    """What an error may depend on; ``name`` as in the results: ``q:A3``, ``time``, .."""

    name: str

    @abstractmethod
    def at(self, state: State) -> Array:
        """Value at each pose, shape (..., m)."""


@dataclass(frozen=True)
class Angle(Variable):
    """The value of a joint as read, rad or m."""

    joint: int
    name: str

    def at(self, state: State) -> Array:
        return state.poses.q[:, self.joint]


@dataclass(frozen=True, eq=False)
class Covariate(Variable):
    """A column of the table: time [s], temperature [degC], approach, size of the move before."""

    field: str
    joint: int | None
    name: str

    def at(self, state: State) -> Array:
        values = getattr(state.poses, self.field)
        return np.asarray(values if self.joint is None else values[:, self.joint])


@dataclass(frozen=True, eq=False)
class Torque(Variable):
    """What a frame transmits along some of its axes: N or N m."""

    frame: int
    axis: Array
    name: str = "load"

    def at(self, state: State) -> Array:
        return np.asarray(state.wrench.local[..., self.frame, :] @ self.axis)


@dataclass(frozen=True, eq=False)
class Curve(TwistEffect):
    """Displacement of a frame along given directions by an unknown function of a variable.

    frame : int; directions : ndarray, shape (6, c)
    knots : ndarray, shape (K,), ascending, of the variable
    """

    frame: int
    directions: Array
    variable: Variable
    knots: Array
    kind: ClassVar[str] = "curve"

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        return ()

    @classmethod
    def at(cls, context: Context, where: str) -> Self:
        raise EffectCannotAct(f"{cls.kind}:{where}", "it is no cause by name", "name another")

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        found = []
        for c in range(self.directions.shape[1]):
            unit = error_unit(bool(self.directions[:3, c].any()))
            for knot in self.knots:
                name = f"{self.variable.name}_{c}@{knot:.4g}"
                found.append(Parameter(self.kind, self.where, name, unit, 1e-6, 1e-3))
        return tuple(found)

    def strands(self, state: State) -> tuple[Strand, ...]:
        hats = hat_functions(self.variable.at(state), self.knots)
        basis = self.directions[:, :, None] * hats[..., None, None, :]
        return ((self.frame, basis.reshape((*basis.shape[:-2], -1))),)


def hat_functions(values: Array, knots: Array) -> Array:
    """Weights of linear interpolation between knots, shape (..., K); constant beyond the ends."""
    inside = np.clip(values, knots[0], knots[-1])
    upper = np.clip(np.searchsorted(knots, inside, side="left"), 1, len(knots) - 1)
    span = knots[upper] - knots[upper - 1]
    share = (inside - knots[upper - 1]) / span
    weights = np.zeros((*values.shape, len(knots)))
    np.put_along_axis(weights, (upper - 1)[..., None], (1.0 - share)[..., None], axis=-1)
    np.put_along_axis(weights, upper[..., None], share[..., None], axis=-1)
    return weights


def knots_of(values: Array) -> Array | None:
    """Knots over what a variable takes, None where it does not vary."""
    distinct = np.unique(np.round(values / max(np.abs(values).max(initial=0.0), _SAME), 9))
    if len(distinct) < 2:
        return None
    low, high = float(values.min()), float(values.max())
    if len(distinct) <= 3:
        return np.unique(values)[[0, -1]] if len(distinct) == 2 else np.linspace(low, high, 3)
    return np.linspace(low, high, min(_KNOTS, len(distinct)))


def curves(context: Context, state: State) -> Iterator[Curve]:
    """Every place with every variable that varies in the data."""
    robot, poses = context.robot, state.poses
    shared = [Angle(k, f"q:{joint}") for k, joint in enumerate(robot.joints)]
    common: list[Variable] = []
    if poses.time is not None:
        common.append(Covariate("time", None, "time"))
    if poses.temperature is not None:
        common.append(Covariate("temperature", None, "temperature"))
    for joint in robot.joints:
        k = joint_index(context, joint)
        axis = along_axis(robot, k)
        variables = [*shared, *common, Torque(k + 1, axis), *_moves(poses, k, joint)]
        yield from _placed(joint, k + 1, axis[:, None], variables, state)
        across = _across(axis)
        if across is not None:
            loads: list[Variable] = [Torque(k + 1, column) for column in across.T]
            yield from _placed(joint, k + 1, across, [shared[k], *loads], state)
    rigid = np.eye(6)
    overturning: list[Variable] = [Torque(0, rigid[:, c]) for c in (3, 4)]
    yield from _placed("base", 0, rigid, [*common, *overturning], state)
    pulls: list[Variable] = [Torque(robot.tip_frame, rigid[:, c]) for c in range(6)]
    yield from _placed("tool", robot.tip_frame, rigid, [*common, *pulls], state)


def _moves(poses: object, k: int, joint: str) -> list[Variable]:
    found: list[Variable] = []
    if getattr(poses, "approach", None) is not None:
        found.append(Covariate("approach", k, f"approach:{joint}"))
    if getattr(poses, "motion", None) is not None:
        found.append(Covariate("motion", k, f"motion:{joint}"))
    return found


def _across(axis: Array) -> Array | None:
    """Rotations across a revolute joint's axis, shape (6, 2)."""
    if axis[:3].any():
        return None
    _, _, Vt = np.linalg.svd(axis[None, 3:])
    return np.concatenate([np.zeros((3, 2)), Vt[1:].T])


def _placed(
    where: str, frame: int, directions: Array, variables: list[Variable], state: State
) -> Iterator[Curve]:
    for variable in variables:
        knots = knots_of(variable.at(state))
        if knots is not None:
            yield Curve(where, frame, directions, variable, knots)
