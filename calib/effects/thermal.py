"""Links that are longer than the nominal model by the temperature.

Links are warmer than the air or the drives beside them only after a while. So a diagnosis also tries
whether they follow the temperature that was read with a time constant, the lag.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import ClassVar

import numpy as np

from calib.arm.robot import Robot
from calib.arrays import Array
from calib.effects.context import ARM, Context, joint_index, needs
from calib.effects.protocol import Effect, Parameter, StretchEffect, Unknown
from calib.effects.tuned import ANY_TUNING, Tuned
from calib.poses import LAGS, Poses

# 1/K: aluminium grows by 23e-6, and a link beside its motor warms by more than the thermometer shows.
_LARGEST = 4e-4
_USUAL = 600.0  # s


@dataclass(frozen=True, eq=False)
class ThermalExpansion(StretchEffect):
    """Links that grow with temperature; the nominal model holds at 20 degC.

    A link grows along its constant translation, from its joint to the origin of the next one (or to
    the tip). ``arm`` means that the whole arm warms up, including the base link up to the first joint.
    """

    kind: ClassVar[str] = "thermal_expansion"
    uses: ClassVar[tuple[str, ...]] = ("temperature",)
    unknowns: ClassVar[tuple[Unknown, ...]] = (("growth", "um/(m K)", 1e-5, _LARGEST),)

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        robot = context.robot
        grown = zip(robot.parents, translations(robot), strict=True)
        long = {parent for parent, length in grown if length.any()}
        return (ARM, *(joint for k, joint in enumerate(robot.joints, 1) if k in long))

    @classmethod
    def at(cls, context: Context, where: str) -> Effect:
        robot, lengths = context.robot, translations(context.robot)
        ends = tuple(range(1, robot.frame_count))
        if where != ARM:
            link = joint_index(context, where) + 1
            ends = tuple(frame for frame, parent in enumerate(robot.parents, 1) if parent == link)
            lengths = lengths[np.array(ends, dtype=int) - 1]
            needs(
                bool(lengths.any()),
                f"{cls.kind}:{where}",
                "the next joint has its origin in this one's",
                "name a link that has a length, or arm",
            )
        if "lag" in (context.parameters or ()):
            return LateExpansion(where=where, ends=ends, lengths=lengths, tuning=_USUAL)
        return cls(where, ends, lengths)

    def forms(self, poses: Poses) -> tuple[Effect, ...]:
        own = {field.name: getattr(self, field.name) for field in fields(ThermalExpansion)}
        return () if poses.lagged is None else (LateExpansion(**own, tuning=_USUAL),)

    def response(self, poses: Poses, values: Array) -> Array:
        return poses.warming[:, None, None]


@dataclass(frozen=True, eq=False)
class LateExpansion(Tuned, ThermalExpansion):
    """The same where links follow the temperature late, with one of the time constants ``LAGS``."""

    smooth: ClassVar[bool] = False

    def forms(self, poses: Poses) -> tuple[Effect, ...]:
        return ()

    @property
    def tuning_parameter(self) -> Parameter:
        return self.parameter("lag", "min", _USUAL, ANY_TUNING)

    @property
    def amplitudes(self) -> tuple[Parameter, ...]:
        return tuple(self.parameter(*unknown) for unknown in self.unknowns)

    def functions(self, poses: Poses, tuning: Array) -> Array:
        return poses.warming_late(tuning)[..., None]

    def slopes(self, poses: Poses, tuning: Array) -> Array:
        return np.zeros((*np.shape(tuning), len(poses), 1))

    def grid(self, poses: Poses) -> Array:
        return np.zeros(0) if poses.lagged is None else LAGS


def translations(robot: Robot) -> Array:
    """Origin of each frame but the base's from the one it hangs on, in its own axes, (F - 1, 3), m."""
    R, p = robot.origins[:, :3, :3], robot.origins[:, :3, 3]
    return np.asarray((p[:, None, :] @ R)[:, 0])
