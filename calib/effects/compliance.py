"""What yields in proportion to the wrench on it: a joint's drive or bearing, the pedestal, the tool."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from calib.arrays import Array
from calib.effects.context import Context, Expectation, joint_index, turning_joints
from calib.effects.drive import DriveError, ElasticDrive, compliance_unit
from calib.effects.protocol import ElasticEffect, Flexibilities, Parameter
from calib.effects.usual import softer
from calib.poses import Poses

_BESIDE_A_GEAR = 0.02  # which yields ten times as much under the same moment (makers' catalogues)
_TILTS = 3e-6  # rad/(N m), of a bearing: a tenth of what gears yield, as makers' catalogues have it
_SENSED = 5e-4  # rad/(N m): joints with torque sensors yield by 30 to 100 urad/(N m)
_SLENDER = 5e-4  # rad/(N m): a changer or a slender tool


@dataclass(frozen=True, eq=False)
class JointCompliance(ElasticDrive):
    """Elastic drive of a joint: ``dq = compliance * torque`` (paper, equation 2, diagonal k_theta)."""

    kind: ClassVar[str] = "joint_compliance"

    @classmethod
    def expected(cls, context: Context, where: str) -> Expectation:
        return Expectation(allowance=softer(context))

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        unit, scale, size = compliance_unit(self.slides)
        return (Parameter(self.kind, self.where, "compliance", unit, scale, size),)

    def shares(self, poses: Poses) -> Array:
        return np.ones((1, 1))


@dataclass(frozen=True, eq=False)
class MeasuredTorque(DriveError):
    """Elastic drive under the torque that the arm measured: ``dq = compliance * torque``.

    The torque comes from the columns ``<joint>_Nm``, positive along the joint's motion. A constant
    torque error counts as an error of the joint's zero.
    """

    kind: ClassVar[str] = "measured_torque"
    uses: ClassVar[tuple[str, ...]] = ("torque",)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        unit, scale, size = compliance_unit(self.slides)
        largest = None if self.slides else _SENSED
        return (Parameter(self.kind, self.where, "compliance", unit, scale, size, largest),)

    def shares(self, poses: Poses) -> Array:
        if poses.torque is None:
            return np.zeros((len(poses), 1))
        return poses.torque[:, self.frame - 1, None]


@dataclass(frozen=True, eq=False)
class TiltingFrame(ElasticEffect):
    """A frame that tilts alike in all directions across an axis, under the moment across it."""

    axis: Array
    largest: ClassVar[float]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter(self.kind, self.where, "tilt", "urad/(N m)", 1e-6, _TILTS, self.largest),)

    def flexibilities(self, poses: Poses) -> Flexibilities:
        K = np.zeros((6, 6))
        K[3:, 3:] = np.eye(3) - np.outer(self.axis, self.axis)
        return {(self.frame, self.frame): K[None, :, :, None]}


@dataclass(frozen=True, eq=False)
class BearingCompliance(TiltingFrame):
    """Elastic bearing of a joint: it tilts across its axis under the moment across it."""

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


@dataclass(frozen=True, eq=False)
class BaseCompliance(TiltingFrame):
    """Elastic pedestal: the base tilts under the overturning moment, across its z axis."""

    kind: ClassVar[str] = "base_compliance"
    # rad/(N m): a robot on a table or a light pedestal has up to 10, one on a telescopic column 15 to
    # 25 (base of the Hilti construction robot on five kinds of ground)
    largest: ClassVar[float] = 3e-5

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        return ("base",)

    @classmethod
    def at(cls, context: Context, where: str) -> Self:
        return cls(where, 0, np.array([0.0, 0.0, 1.0]))

    @classmethod
    def expected(cls, context: Context, where: str) -> Expectation:
        return Expectation(allowance=softer(context))


@dataclass(frozen=True, eq=False)
class ToolCompliance(ElasticEffect):
    """Elastic flange and tool: the tip frame moves in proportion to the wrench on it."""

    kind: ClassVar[str] = "tool_compliance"

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        return ("tool",)

    @classmethod
    def at(cls, context: Context, where: str) -> Self:
        return cls(where, context.robot.tip_frame)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        slide = [Parameter(self.kind, self.where, c, "nm/N", 1e-9, 1e-7) for c in "xyz"]
        turn = [
            Parameter(self.kind, self.where, f"r{c}", "urad/(N m)", 1e-6, 1e-6, _SLENDER)
            for c in "xyz"
        ]
        return (*slide, *turn)

    def flexibilities(self, poses: Poses) -> Flexibilities:
        diagonal = np.zeros((1, 6, 6, 6))
        diagonal[0, range(6), range(6), range(6)] = 1.0
        return {(self.frame, self.frame): diagonal}
