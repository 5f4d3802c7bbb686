"""Effects that follow the session's clock by a function with one tuning, at any place that may move."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from calib.arrays import Array
from calib.effects.context import Context, joint_index, motion_of
from calib.effects.drive import along_axis, error_unit
from calib.effects.protocol import ConstantTwist, Effect, FrameEffect, Parameter
from calib.effects.readings import MarkerEffect, PartEffect, RigidReading
from calib.effects.tuned import Tuned
from calib.poses import Poses

SECONDS = "s"
MARKER = "marker:"
_USUAL = 3600.0  # s: where the search for a tuning begins
_USUAL_READINGS = 100.0


@dataclass(frozen=True, eq=False)
class Timed(Tuned):
    """One function of the clock, times what its place can do; a subclass of it for each kind of place.

    clock : str, unit of the session's clock (:attr:`calib.poses.Poses.clock_unit`)
    units : tuple of str, unit of the error in each direction
    """

    clock: str
    units: tuple[str, ...]
    uses: ClassVar[tuple[str, ...]] = ("time",)
    flexible: ClassVar[bool] = True
    size: ClassVar[float]
    largest: ClassVar[float]

    @classmethod
    def at(cls, context: Context, where: str) -> Effect:
        slot, directions = _placement(context, where)
        kind = next(own for own in cls.__subclasses__() if issubclass(own, slot))
        tuning = _USUAL if context.clock_unit == SECONDS else _USUAL_READINGS
        return kind(where=where, tuning=tuning, clock=context.clock_unit, **directions)

    @property
    def amplitudes(self) -> tuple[Parameter, ...]:
        names = ("offset",) if len(self.units) == 1 else ConstantTwist.names
        return tuple(
            Parameter(self.kind, self.where, name, unit, 1e-6, self.size, self.largest)
            for name, unit in zip(names, self.units, strict=False)
        )


def _placement(context: Context, where: str) -> tuple[type[Effect], Mapping[str, Any]]:
    """What moves at a place, and its directions as the fields of a timed effect there."""
    robot = context.robot
    units = ("um",) * 3 + ("urad",) * 3
    part = context.parts.get(where)
    if part is not None:
        numbers = motion_of(part)
        return PartEffect, {"units": units[numbers], "numbers": numbers, "body": part.body}
    if where == "instrument":
        return RigidReading, {"units": units}
    if where.startswith(MARKER):
        return MarkerEffect, {"units": units[:3]}
    if where == "base":
        return FrameEffect, {"units": units, "frame": 0, "directions": np.eye(6)}
    joint = joint_index(context, where)
    unit = error_unit(bool(robot.prismatic[joint]))
    along = along_axis(robot, joint)[:, None]
    return FrameEffect, {"units": (unit,), "frame": joint + 1, "directions": along}


def everything(context: Context) -> tuple[str, ...]:
    """Base, instrument and every joint: what heat moves."""
    read = ("instrument",) if context.reads("points") else ()
    return ("base", *read, *context.robot.joints)


def markers(context: Context) -> tuple[str, ...]:
    """Every marker by its place."""
    return tuple(MARKER + name for name in context.single_markers)


def function_of(values: Array, tuning: Array, poses: Poses) -> Array:
    """One function's values, shape (..., m, 1), in the shape of the tunings (...)."""
    return np.broadcast_to(values, (*np.shape(tuning), len(poses)))[..., None]
