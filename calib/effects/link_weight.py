"""Wrong mass of a link: a correction to the URDF's mass, at the same centre of mass."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

from calib.arm.statics import Loads
from calib.effects.context import Context, joint_index, needs
from calib.effects.protocol import Parameter, WeightEffect
from calib.poses import Poses

_SHARE = 0.1  # of a link's mass: plausible error


@dataclass(frozen=True, eq=False)
class LinkWeight(WeightEffect):
    """Correction of the mass of the link that moves with a joint.

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
