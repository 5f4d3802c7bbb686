"""What yields in proportion to the wrench on it: a joint's drive or bearing, the pedestal, the tool."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, field
from typing import ClassVar, Self

import numpy as np

from calib.arrays import Array
from calib.effects.context import Context, Expectation, joint_index, needs, softer, turning_joints
from calib.effects.joint import OnJoint, along_axis, compliance_unit
from calib.effects.protocol import ElasticEffect, Flexibilities, Parameter, Unknown
from calib.errors import CalibError
from calib.poses import Poses

_AT = "compliance@"
_BESIDE_A_GEAR = 0.02  # which yields ten times as much under the same moment (makers' catalogues)
_TILTS = 3e-6  # rad/(N m), of a bearing: a tenth of what gears yield, as makers' catalogues have it
_SLENDER = 5e-4  # rad/(N m): a changer or a slender tool


@dataclass(frozen=True, eq=False)
class ElasticDrive(OnJoint, ElasticEffect):
    """A joint that yields along its own variable: ``dq = compliance * torque``.

    Paper, equation 2 with a diagonal k_theta. A drive that moves joint j by ``factor_j`` of its own
    motion feels ``factor_j * torque_j`` of it, by virtual work: it yields under the sum, and all that
    it moves go with it.

    moves : joints that couplings move with it: frame of each, and unit displacement (6,) times factor
    """

    moves: tuple[tuple[int, Array], ...] = field(default=(), kw_only=True)

    @classmethod
    def at(cls, context: Context, where: str) -> Self:
        robot, joint = context.robot, joint_index(context, where)
        moves = tuple(
            (other + 1, factor * along_axis(robot, other))
            for other, factor in enumerate(robot.driven[:, joint].tolist())
            if factor and other != joint
        )
        return cls(where, joint + 1, along_axis(robot, joint), moves=moves)

    @property
    def _along(self) -> tuple[tuple[int, Array], ...]:
        """Frames that the drive moves and their displacements (6,), its own joint's first."""
        return ((self.frame, self.axis), *self.moves)

    @abstractmethod
    def shares(self, poses: Poses) -> Array:
        """What each parameter adds to the compliance at each pose, shape (m or 1, p)."""

    def flexibilities(self, poses: Poses) -> Flexibilities:
        shares = self.shares(poses)[:, None, None, :]
        return {
            (moved, stressed): np.outer(way, axis)[:, :, None] * shares
            for moved, way in self._along
            for stressed, axis in self._along
        }


@dataclass(frozen=True, eq=False)
class JointCompliance(ElasticDrive):
    """Elastic drive of a joint: ``dq = compliance * torque`` (paper, equation 2, diagonal k_theta)."""

    kind: ClassVar[str] = "joint_compliance"

    @classmethod
    def expected(cls, context: Context, where: str) -> Expectation:
        return Expectation(allowance=softer(context))

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (self.parameter("compliance", *compliance_unit(self.slides)),)

    def shares(self, poses: Poses) -> Array:
        return np.ones((1, 1))


@dataclass(frozen=True, eq=False)
class StiffnessVsAngle(ElasticDrive):
    """Compliance of a joint that depends on its own angle (the paper's chi_21 .. chi_25).

    It has one coefficient at each knot, is linear between them, and constant beyond the ends.
    """

    knots: Array = field(default_factory=lambda: np.zeros(1), kw_only=True)
    kind: ClassVar[str] = "stiffness_vs_angle"
    parts: ClassVar[tuple[str, ...]] = ("joint_compliance",)

    @classmethod
    def at(cls, context: Context, where: str) -> Self:
        drive, knots = JointCompliance.at(context, where), _knots_of(context, where)
        return cls(where, drive.frame, drive.axis, moves=drive.moves, knots=np.sort(knots))

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        shown = self.knots * 1e3 if self.slides else np.degrees(self.knots)
        return tuple(
            self.parameter(f"{_AT}{knot:.6g}", *compliance_unit(self.slides))
            for knot in np.round(shown, 6) + 0.0
        )

    @property
    def depends_on(self) -> str:
        return f"q:{self.where}"

    def shares(self, poses: Poses) -> Array:
        q = poses.q[:, self.frame - 1]
        return np.column_stack([np.interp(q, self.knots, row) for row in np.eye(len(self.knots))])


def _knots_of(context: Context, where: str) -> Array:
    """The knots that the context gives, or those that the parameters of a result name."""
    if context.parameters is None:
        needs(
            where in context.knots,
            f"{StiffnessVsAngle.kind}:{where}",
            "no angles are given and no poses to take them from",
            f"add [model.knots_deg] {where} = [..] to the cell",
        )
        return context.knots[where]
    try:
        shown = np.array([float(name.removeprefix(_AT)) for name in context.parameters])
    except ValueError:
        raise CalibError(f"{context.parameters[0][:40]!r} is no angle of a compliance") from None
    slides = context.robot.prismatic[joint_index(context, where)]
    return shown * 1e-3 if slides else np.radians(shown)


@dataclass(frozen=True, eq=False)
class TiltingFrame(ElasticEffect):
    """A frame that tilts alike in all directions across an axis, under the moment across it."""

    axis: Array

    @classmethod
    def expected(cls, context: Context, where: str) -> Expectation:
        return Expectation(allowance=softer(context))

    def flexibilities(self, poses: Poses) -> Flexibilities:
        K = np.zeros((6, 6))
        K[3:, 3:] = np.eye(3) - np.outer(self.axis, self.axis)
        return {(self.frame, self.frame): K[None, :, :, None]}


@dataclass(frozen=True, eq=False)
class BearingCompliance(TiltingFrame):
    """Elastic bearing of a joint: it tilts across its axis under the moment across it."""

    kind: ClassVar[str] = "bearing_compliance"
    # rad/(N m): crossed roller bearings of small gears tilt by 5 to 20 urad/(N m) (makers' catalogues),
    # large ones by less than one.
    unknowns: ClassVar[tuple[Unknown, ...]] = (("tilt", "urad/(N m)", _TILTS, 2e-4),)

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
    unknowns: ClassVar[tuple[Unknown, ...]] = (("tilt", "urad/(N m)", _TILTS, 3e-5),)

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        return ("base",)

    @classmethod
    def at(cls, context: Context, where: str) -> Self:
        return cls(where, 0, np.array([0.0, 0.0, 1.0]))


@dataclass(frozen=True, eq=False)
class ToolCompliance(ElasticEffect):
    """Elastic flange and tool: the tip frame moves in proportion to the wrench on it."""

    kind: ClassVar[str] = "tool_compliance"
    unknowns: ClassVar[tuple[Unknown, ...]] = (
        *((c, "nm/N", 1e-7) for c in "xyz"),
        *((f"r{c}", "urad/(N m)", 1e-6, _SLENDER) for c in "xyz"),
    )

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        return ("tool",)

    @classmethod
    def at(cls, context: Context, where: str) -> Self:
        return cls(where, context.robot.tip_frame)

    def flexibilities(self, poses: Poses) -> Flexibilities:
        diagonal = np.zeros((1, 6, 6, 6))
        diagonal[0, range(6), range(6), range(6)] = 1.0
        return {(self.frame, self.frame): diagonal}
