"""Wrong masses: of a link in the robot's file, or of the payload."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from calib.arm.statics import Loads, Payload
from calib.effects.context import Context, joint_index, needs
from calib.effects.protocol import Parameter, WeightEffect
from calib.poses import Poses

_SHARE = 0.1  # of a mass or a wrench: plausible error
_UNKNOWN = 10.0  # kg: plausible mass of a forgotten tool
_COM = 0.02  # m


@dataclass(frozen=True, eq=False)
class LinkWeight(WeightEffect):
    """Wrong mass of a link: a correction to the URDF's mass, at the same centre of mass.

    frame : int; given : float, kg; com : tuple of float, m, in the frame that moves with the joint
    """

    frame: int
    given: float
    com: tuple[float, float, float]
    kind: ClassVar[str] = "link_weight"

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        robot = context.robot
        return tuple(j for j, mass in zip(robot.joints, robot.masses, strict=True) if mass > 0.0)

    @classmethod
    def at(cls, context: Context, where: str) -> Self:
        joint, robot = joint_index(context, where), context.robot
        mass = float(robot.masses[joint])
        needs(
            mass > 0.0,
            f"{cls.kind}:{where}",
            "the robot's file gives this link no mass to correct",
            "add its <inertial>, or use gravity_sag",
        )
        x, y, z = robot.coms[joint]
        return cls(where, joint + 1, mass, (float(x), float(y), float(z)))

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter(self.kind, self.where, "mass", "kg", 1.0, _SHARE * self.given),)

    def changes(self, poses: Poses, loads: Loads) -> tuple[Loads, ...]:
        one = loads.nothing()
        one.mass[:, self.frame] = 1.0
        one.mass_moment[:, self.frame] = self.com
        return (one,)


@dataclass(frozen=True, eq=False)
class PayloadError(WeightEffect):
    """Wrong mass or centre of mass of the payload.

    If the cell has a [payload], its mass and centre of mass are corrected. Otherwise the poses may
    have a load: a measured wrench, or a plan's [load]. Then ``scale`` is the error of that load, and
    the centre shifts the point at which it acts. Without both, ``mass`` is an unknown body at the
    point that the cell gives. Its centre cannot be corrected then. All are corrections to first order.

    given : Payload; measured : bool, whether the load of the poses is meant in its place
    frame : int, of the tip that carries what is meant
    """

    given: Payload
    measured: bool
    frame: int = -1
    kind: ClassVar[str] = "payload"

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        return ("payload",)

    @classmethod
    def at(cls, context: Context, where: str) -> Self:
        given = context.payload
        measured = given.mass == 0.0 and context.measured_load
        return cls(where, given, measured, context.robot.loaded if measured else given.frame)

    @classmethod
    def named(cls, context: Context, where: str, parameters: Sequence[str]) -> Self:
        return cls.at(replace(context, measured_load="scale" in parameters), where)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        mass = self.given.mass
        com = [Parameter(self.kind, self.where, f"com_{c}", "mm", 1e-3, _COM) for c in "xyz"]
        if self.measured:
            return (Parameter(self.kind, self.where, "scale", "1", 1.0, _SHARE), *com)
        first = Parameter(self.kind, self.where, "mass", "kg", 1.0, _SHARE * mass or _UNKNOWN)
        return (first, *com) if mass > 0.0 else (first,)

    def changes(self, poses: Poses, loads: Loads) -> tuple[Loads, ...]:
        size, *shifts = [loads.nothing() for _ in self.parameters]
        if self.measured:
            size.mass[:, self.frame] = poses.load_mass
            size.mass_moment[:, self.frame] = poses.load_mass[:, None] * poses.load_com
            size.force[:], size.moment[:] = loads.force, loads.moment
        else:
            size.mass[:, self.frame] = 1.0
            size.mass_moment[:, self.frame] = self.given.com
        for shift, axis in zip(shifts, np.eye(3), strict=False):
            body = poses.load_mass if self.measured else np.full(len(poses), self.given.mass)
            shift.mass_moment[:, self.frame] = body[:, None] * axis
            shift.lever[:] = axis * self.measured
        return (size, *shifts)
