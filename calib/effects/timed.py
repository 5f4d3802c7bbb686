"""Effects that follow the session's clock by a function with one tuning, at any place that may move."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from calib.arrays import Array
from calib.effects.drive import along_axis, error_unit
from calib.effects.protocol import ConstantTwist, Context, Parameter, joint_index, motion_of
from calib.effects.tuned import Tuned
from calib.poses import Poses

SECONDS = "s"
MARKER = "marker:"


@dataclass(frozen=True, eq=False)
class Timed(Tuned):
    """One function of the clock, times what its place can do.

    clock : str, unit of the session's clock (:attr:`calib.poses.Poses.clock_unit`)
    units : tuple of str, unit of the error in each direction
    """

    clock: str
    units: tuple[str, ...]
    uses: ClassVar[tuple[str, ...]] = ("time",)
    flexible: ClassVar[bool] = True
    size: ClassVar[float]
    largest: ClassVar[float]

    @property
    def amplitudes(self) -> tuple[Parameter, ...]:
        names = ("offset",) if len(self.units) == 1 else ConstantTwist.names
        return tuple(
            Parameter(self.kind, self.where, name, unit, 1e-6, self.size, self.largest)
            for name, unit in zip(names, self.units, strict=False)
        )


def placement(context: Context, where: str) -> Mapping[str, Any]:
    """Directions in which a place moves, as the fields of a timed effect there."""
    robot = context.robot
    units = ("um",) * 3 + ("urad",) * 3
    part = context.parts.get(where)
    if part is not None:
        numbers = motion_of(part)
        return {"units": units[numbers], "numbers": numbers, "body": part.body}
    if where == "instrument":
        return {"units": units}
    if where.startswith(MARKER):
        return {"units": units[:3]}
    if where == "base":
        return {"units": units, "frame": 0, "directions": np.eye(6)}
    joint = joint_index(context, where)
    unit = error_unit(bool(robot.prismatic[joint]))
    along = along_axis(robot, joint)[:, None]
    return {"units": (unit,), "frame": joint + 1, "directions": along}


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
