"""Elastic bearing of a joint: it tilts across its axis under the moment across it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from calib.arrays import Array
from calib.effects.context import Context, Expectation, joint_index, turning_joints
from calib.effects.protocol import ElasticEffect, Parameter
from calib.effects.usual import softer
from calib.poses import Poses

_BESIDE_A_GEAR = 0.02  # which yields ten times as much under the same moment (makers' catalogues)


@dataclass(frozen=True, eq=False)
class BearingCompliance(ElasticEffect):
    """Tilt of one joint, alike in all directions across its axis."""

    axis: Array
    kind: ClassVar[str] = "bearing_compliance"
    turns: ClassVar[bool] = True
    # rad/(N m): crossed roller bearings of small gears tilt by 5 to 20 urad/(N m) (makers' catalogues),
    # large ones by less than one.
    largest: ClassVar[float] = 2e-4

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        return turning_joints(context)

    @classmethod
    def at(cls, context: Context, where: str) -> Self:
        joint = joint_index(context, where)
        return cls(where, joint + 1, context.robot.axes[joint])

    @classmethod
    def expected(cls, context: Context, where: str) -> Expectation:
        return Expectation(allowance=softer(context), twin_odds=_BESIDE_A_GEAR)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter(self.kind, self.where, "tilt", "urad/(N m)", 1e-6, 1e-7, self.largest),)

    def flexibility(self, poses: Poses) -> Array:
        K = np.zeros((6, 6))
        K[3:, 3:] = np.eye(3) - np.outer(self.axis, self.axis)
        return K[None, :, :, None]
