"""Causes without a name: a place that is off by an unknown function of one variable.

Beside the catalogue such a curve locates what the catalogue cannot explain, and its
coefficients show how the error runs.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Self

import numpy as np

from calib.arrays import Array
from calib.diagnosis.functions import (
    ErrorVariable,
    Function,
    PoseVariable,
    Posture,
    Pull,
    Statics,
    Torque,
    neighbours,
    polyline,
    pose_variables,
)
from calib.effects.context import Context, motion_of
from calib.effects.joint import along_axis, error_unit
from calib.effects.protocol import DirectedEffect, Effect, FrameEffect, Parameter
from calib.effects.readings import MarkerEffect, PartEffect, ReadingEffect
from calib.errors import EffectCannotAct
from calib.poses import Poses

_KNOTS = 12
_KNOTS_EACH = 8  # where several directions share the evidence
_LOCKED = 1e-3  # rad or m: a joint that scatters less stands still
_SIZE = 1e-3  # rad or m, a plausible coefficient


@dataclass(frozen=True, eq=False)
class Curve(Effect):
    """An unknown function of a variable; coefficients direction by direction.

    variable : ErrorVariable; function : Function
    """

    variable: ErrorVariable
    function: Function
    kind: ClassVar[str] = "curve"

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        return ()

    @classmethod
    def at(cls, context: Context, where: str) -> Self:
        raise EffectCannotAct(f"{cls.kind}:{where}", "it is no cause by name", "name another")

    @property
    @abstractmethod
    def units(self) -> tuple[str, ...]:
        """Unit of the error in each direction."""

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        return tuple(
            Parameter(self.kind, self.where, f"{self.variable.name}_{c}@{at}", unit, 1e-6, _SIZE)
            for c, unit in enumerate(self.units)
            for at in self.function.labels
        )

    @property
    def depends_on(self) -> str:
        return self.variable.name

    @property
    def spread(self) -> Array:
        """Covariance of the coefficients a priori, shape (p, p), of unit amplitude."""
        return np.asarray(np.kron(np.eye(len(self.units)), self.function.spread))


@dataclass(frozen=True, eq=False)
class PoseCurve(Curve, DirectedEffect):
    """A curve over what is known of the pose."""

    variable: PoseVariable

    def basis(self, poses: Poses) -> Array:
        """Values of the basis functions at poses, shape (m, K)."""
        return self.function.at(self.variable.at(poses))

    def response(self, poses: Poses, values: Array) -> Array:
        return np.asarray(np.kron(np.eye(len(self.units)), self.basis(poses)[:, None, :]))


@dataclass(frozen=True, eq=False)
class TwistCurve(PoseCurve, FrameEffect):
    """Displacement of a frame along given directions."""

    @property
    def units(self) -> tuple[str, ...]:
        return tuple(error_unit(bool(d[:3].any())) for d in self.directions.T)


@dataclass(frozen=True, eq=False)
class MarkerCurve(PoseCurve, MarkerEffect):
    """Displacement of one marker in the tip frame."""

    @property
    def units(self) -> tuple[str, ...]:
        return ("um", "um", "um")


@dataclass(frozen=True, eq=False)
class PartCurve(PoseCurve, PartEffect):
    """Displacement of a part of an instrument, or of what it looks at."""

    @property
    def units(self) -> tuple[str, ...]:
        own: tuple[str, ...] = ("um",) * 3 + ("urad",) * 3
        return own[self.numbers]


@dataclass(frozen=True, eq=False)
class RangeCurve(Curve, ReadingEffect):
    """Distances from the station that are read wrong."""

    @property
    def units(self) -> tuple[str, ...]:
        return ("um",)

    def linearise(self, values: Array, poses: Poses, points: Array) -> tuple[Array, Array, Array]:
        del poses  # the point says it all
        away = np.linalg.norm(points, axis=-1)
        along = points / np.maximum(away, 1e-9)[..., None]
        own = along[..., None] * self.function.at(away)[..., None, :]
        read = points + (own @ values[..., None, None, :, None])[..., 0]
        # Its slope is the error over the range, parts in a million: none for the search.
        return read, np.broadcast_to(np.eye(3), (*points.shape, 3)), own


def curves(context: Context, poses: Poses, ranges: Array) -> Iterator[Curve]:
    """Unnamed curves: every place, over every variable that varies in the data.

    ranges : ndarray, shape (n,), m, distances of the visible points from their stations
    """
    robot, statics = context.robot, Statics(context.robot, context.payload, context.gravity)
    known = pose_variables(robot, poses)
    angles = [known[f"q:{joint}"] for joint in robot.joints]
    common = [known[name] for name in ("time", "temperature") if name in known]
    deviation = np.std(poses.q, axis=0)
    spread = tuple(np.where(deviation > _LOCKED, deviation, np.inf).tolist())
    for k, joint in enumerate(robot.joints):
        axis = along_axis(robot, k)
        moved: list[PoseVariable] = [*angles, *common, Torque("load", statics, k + 1, axis)]
        moved += [known[name] for name in (f"approach:{joint}", f"motion:{joint}") if name in known]
        yield from _twists(joint, k + 1, axis[:, None], moved, poses, _KNOTS)
        posture = Posture(f"q:{joint}", spread)
        around = neighbours(posture.at(poses))
        if len(around.centres) > _KNOTS:
            yield TwistCurve(joint, k + 1, axis[:, None], posture, around)
        across = _across(axis)
        if across is not None:
            loads = [Torque("load", statics, k + 1, column) for column in across.T]
            yield from _twists(joint, k + 1, across, [angles[k], *loads], poses, _KNOTS_EACH)
    rigid = np.eye(6)
    overturning = [Torque("load", statics, 0, rigid[:, c]) for c in (3, 4)]
    yield from _twists("base", 0, rigid, [*common, *overturning], poses, _KNOTS_EACH)
    pulls = [Torque("load", statics, robot.tip_frame, rigid[:, c]) for c in range(6)]
    yield from _twists("tool", robot.tip_frame, rigid, [*common, *pulls], poses, _KNOTS_EACH)
    for name in context.single_markers:
        for variable in (*common, Pull("load", statics)):
            line = polyline(variable.at(poses), _KNOTS_EACH)
            if line is not None:
                yield MarkerCurve(f"marker:{name}", variable, line)
    for where, part in context.parts.items():
        for variable in common:
            line = polyline(variable.at(poses), _KNOTS_EACH)
            if line is not None:
                yield PartCurve(where, motion_of(part), part.body, variable, line)
    line = polyline(ranges, _KNOTS)
    if line is not None and context.reads("points"):
        yield RangeCurve("instrument", ErrorVariable("range"), line)


def _across(axis: Array) -> Array | None:
    """Rotations across a revolute joint's axis, shape (6, 2)."""
    if axis[:3].any():
        return None
    _, _, Vt = np.linalg.svd(axis[None, 3:])
    return np.concatenate([np.zeros((3, 2)), Vt[1:].T])


def _twists(
    where: str,
    frame: int,
    directions: Array,
    variables: Sequence[PoseVariable],
    poses: Poses,
    most: int,
) -> Iterator[TwistCurve]:
    for variable in variables:
        line = polyline(variable.at(poses), most)
        if line is not None:
            yield TwistCurve(where, frame, directions, variable, line)
