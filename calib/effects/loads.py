"""What changes the loads on the arm: a spring, friction, wrong masses, and sag by unknown masses."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from calib.arm.kinematics import forward
from calib.arm.robot import Robot
from calib.arm.se3 import across, cross, rotate, so3_exp
from calib.arm.statics import Loads, Payload
from calib.arrays import Array
from calib.effects.context import (
    ARM,
    Context,
    Expectation,
    heavy,
    joint_index,
    light,
    needs,
    turning_joints,
)
from calib.effects.joint import OnJoint, along_axis, error_unit
from calib.effects.protocol import (
    Effect,
    LoadEffect,
    Parameter,
    PoseEffect,
    Twist,
    Unknown,
    WeightEffect,
)
from calib.poses import Poses

_ABOVE, _ALONG = 1 / 5, 1 / 20  # of the arm's reach: distances of the default anchors
_LAST = 1  # the second joint that turns is the last that makers balance, on heavy arms
_SELDOM, _NEVER = 1e-2, 1e-4  # odds elsewhere, and at the elbow and the wrist
_TOO_STEEP = 0.1  # sine of a direction to the joint's axis below which it is no direction across
# N m or N: small arms wind up by 0.1 N m, large ones by tens, most of it lost in the gear.
_FRICTION, _MOST_FRICTION = 5.0, 500.0
_SHARE = 0.1  # of a mass or a wrench: plausible error
_UNKNOWN = 10.0  # kg: plausible mass of a forgotten tool
_COM = 0.02  # m
_SAG = 1e-4  # rad, or m
_MOST_SAG = 1e-2  # of a light arm's joint, 10 urad/(N m), under 1000 N m
_KNOWN = "the masses of the links are known: joint_compliance and link_weight say how the arm sags"
_SERVICE = 3.0  # strain-wave joints of 300 to 450 urad/(N m) under 70 N m (DLR Agile Justin)


@dataclass(frozen=True, eq=False)
class SpringEffect(OnJoint, LoadEffect):
    """A wrench between two links, along the variable of the joint between them."""

    @abstractmethod
    def torques(self, poses: Poses) -> Array:
        """D torque (or force) / d parameter at each pose, shape (m, p), SI."""

    def wrench_basis(self, poses: Poses, frames: int) -> Array:
        """D w / d parameter, shape (m, frames, 6, p), in the axes of each frame of the arm."""
        torques = self.torques(poses)
        basis = np.zeros((len(poses), frames, 6, torques.shape[-1]))
        basis[:, self.frame] = self.axis[:, None] * torques[:, None, :]
        return basis


@dataclass(frozen=True, eq=False)
class GravityCompensator(SpringEffect):
    """Spring and preload of a compensator on a revolute joint, evaluated at the angle as read.

    The spring runs from an anchor P0 on the link before the joint to an anchor P2 on the link after
    it. It pulls with ``F = preload + spring * (s - s(0))``, where s is its length. Its torque about
    the joint's axis a is ``F / s * a . (P2 x P0)``, with the anchors measured from the joint's
    origin: the torque M_c of the compensator model of Klimchik et al. (ICRA 2013), with the force at
    zero angle in place of the free length. The spring also stiffens the joint, by far less than the
    drive's own stiffness varies; that part belongs to ``stiffness_vs_angle``.
    """

    anchors: Array
    kind: ClassVar[str] = "gravity_compensator"
    turns: ClassVar[bool] = True
    unknowns: ClassVar[tuple[Unknown, ...]] = (("spring", "N/mm", 1e5), ("preload", "N", 1e4))

    @classmethod
    def at(cls, context: Context, where: str) -> Self:
        joint, given = joint_index(context, where), context.anchors.get(where)
        anchors = default_anchors(context, joint) if given is None else given
        return cls(where, joint + 1, along_axis(context.robot, joint), anchors)

    @classmethod
    def expected(cls, context: Context, where: str) -> Expectation:
        turning = turning_joints(context).index(where)
        if where in context.anchors or (heavy(context) and turning == _LAST):
            return Expectation()
        return Expectation(odds=_NEVER if turning > _LAST else _SELDOM)

    @property
    def depends_on(self) -> str:
        return f"q:{self.where}"

    def torques(self, poses: Poses) -> Array:
        return spring_torques(self.axis[3:], self.anchors, poses.q[:, self.frame - 1])


def spring_torques(axis: Array, anchors: Array, q: Array) -> Array:
    """Torques on a joint by a unit of spring and of preload of its compensator, shape (m, 2).

    axis : ndarray, shape (3,); anchors : ndarray, shape (2, 3), m; q : ndarray, shape (m,), rad
    """
    before, after = anchors
    moved = rotate(so3_exp(axis * q[:, None]), after)
    s = np.linalg.norm(moved - before, axis=-1)
    lever = cross(moved, np.broadcast_to(before, moved.shape)) @ axis / s
    return np.column_stack([(s - np.linalg.norm(after - before)) * lever, lever])


def default_anchors(context: Context, joint: int) -> Array:
    """Anchors of an equivalent spring, before and after the joint, shape (2, 3), m, joint's frame.

    They are where a spring balances best at zero angles: P0 straight above the joint, at a fifth of
    the arm's reach, P2 on the link beyond, at a twentieth. The torque then opposes the link's weight on
    a robot of any size. On the KR 270 this gives 0.59 m and 0.15 m; its own anchors are at 0.70 m and
    0.18 m. Other distances give nearly the same torque curves with other springs and preloads.
    """
    robot = context.robot
    frames = forward(robot, np.zeros((1, robot.dof)))
    R, o = frames.R[0, joint + 1], frames.o[0]
    carried = np.flatnonzero(robot.carries[joint + 1])[1:]
    beyond = list((o[carried] - o[joint + 1]) @ R)
    either, other = across(robot.axes[joint])
    above = _first_across(robot.axes[joint], [-context.gravity @ R], either)
    along = _first_across(robot.axes[joint], beyond, other)
    return robot.reach * np.stack([_ABOVE * above, _ALONG * along])


def _first_across(axis: Array, directions: list[Array], otherwise: Array) -> Array:
    """Unit vector across the axis of the first direction that has such a part."""
    for direction in directions:
        part = direction - axis * (axis @ direction)
        size = float(np.linalg.norm(part))
        if size > _TOO_STEEP * float(np.linalg.norm(direction)):
            return np.asarray(part / size)
    return otherwise


@dataclass(frozen=True, eq=False)
class FrictionWindup(SpringEffect):
    """Friction of a joint that winds up its elastic drive: ``dq = -compliance torque approach``.

    Friction acts against the last motion, and the joint's compliance makes it visible. The model
    needs a compliance of this joint. With a constant compliance, this effect is observationally
    equivalent to ``backlash``.
    """

    kind: ClassVar[str] = "friction_windup"
    uses: ClassVar[tuple[str, ...]] = ("approach",)

    @classmethod
    def repeats(cls, where: str, active: Sequence[Effect]) -> str | None:
        """The kind to which it is equivalent beside the active effects, None for a cause of its own.

        It is the empty string where the effect would move nothing.
        """
        here = {effect.kind for effect in active if effect.where == where}
        if "stiffness_vs_angle" in here:
            return None
        return "backlash" if "joint_compliance" in here else ""

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        named = ("force", "N") if self.slides else ("torque", "N m")
        return (self.parameter(*named, _FRICTION, _MOST_FRICTION),)

    def torques(self, poses: Poses) -> Array:
        if poses.approach is None:
            return np.zeros((len(poses), 1))
        return -poses.approach[:, self.frame - 1, None]


@dataclass(frozen=True, eq=False)
class LinkWeight(WeightEffect):
    """Wrong mass of a link: a correction to the URDF's mass, at the same centre of mass.

    frame : int; given : float, kg; com : ndarray, shape (3,), m, in the frame that moves with the joint
    """

    frame: int
    given: float
    com: Array
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
        return cls(where, joint + 1, mass, robot.coms[joint])

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (self.parameter("mass", "kg", _SHARE * self.given),)

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
        given, names = context.payload, context.parameters
        load = context.measured_load if names is None else "scale" in names
        measured = given.mass == 0.0 and load
        return cls(where, given, measured, context.robot.loaded if measured else given.frame)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        mass = self.given.mass
        com = [self.parameter(f"com_{c}", "mm", _COM) for c in "xyz"]
        if self.measured:
            return (self.parameter("scale", "1", _SHARE), *com)
        first = self.parameter("mass", "kg", _SHARE * mass or _UNKNOWN)
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


@dataclass(frozen=True, eq=False)
class GravitySag(PoseEffect):
    """Sag of one joint, or of every joint (``arm``), under the arm's own weight, for unknown masses.

    The weight of all links beyond joint k turns it by ``compliance * a_k . sum_l (R_l b_l) x g``.
    Here b_l is the first moment of link l, with everything that hangs beyond it. Compliance and
    moment are both unknown, so the parameters are their products with g. The part of b_l along joint
    l's own axis belongs to the link before: a joint that turns has two parameters across its axis,
    ``u_<joint>`` and ``v_<joint>``. A joint that slides shifts everything beyond it:
    ``travel_<joint>``. Under a joint that slides itself, weight and compliance have one product. The
    angles are those that were read; the arm's own deflection changes them too little to matter.

    sagging : tuple of int, positions of the joints that sag
    down : ndarray, shape (3,), unit vector of gravity in base axes
    """

    robot: Robot
    sagging: tuple[int, ...]
    down: Array
    kind: ClassVar[str] = "gravity_sag"

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        return (ARM, *context.robot.joints)

    @classmethod
    def at(cls, context: Context, where: str) -> Self:
        robot = context.robot
        joints = range(robot.dof) if where == ARM else [joint_index(context, where)]
        size = float(np.linalg.norm(context.gravity))
        return cls(where, robot, tuple(joints), context.gravity / (size or 1.0))

    @classmethod
    def expected(cls, context: Context, where: str) -> Expectation:
        return Expectation(
            allowance=_SERVICE if light(context) else 1.0,
            instead=_KNOWN if context.robot.masses.any() else "",
        )

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        products = [product for k in self.sagging for product in self._products(k)]
        return tuple(self.parameter(*product, _SAG, _MOST_SAG) for product in products)

    def contains(self, kind: str, where: str) -> bool:
        return kind == self.kind and self.where == ARM != where

    def _products(self, k: int) -> list[tuple[str, str]]:
        """Names and units of the products at joint k; the travel of a joint that slides is a factor."""
        robot, unit = self.robot, error_unit(bool(self.robot.prismatic[k]))
        prefix = f"{robot.joints[k]}_" if self.where == ARM else ""
        if robot.prismatic[k]:
            return [(f"{prefix}weight", unit)]
        products: list[tuple[str, str]] = []
        for j in robot.beyond(k):
            joint = robot.joints[j]
            if robot.prismatic[j]:
                products.append((f"{prefix}travel_{joint}", f"{unit}/m"))
            else:
                products += [(f"{prefix}u_{joint}", unit), (f"{prefix}v_{joint}", unit)]
        return products

    def twists_at(self, poses: Poses, values: Array) -> tuple[Twist, ...]:
        R = forward(self.robot, poses.q).R_link
        twists, first, count = [], 0, len(self.parameters)
        for k in self.sagging:
            turned = self._turned(k, R, poses.q)
            columns = np.zeros((len(poses), count))
            columns[:, first : first + turned.shape[1]] = turned
            first += turned.shape[1]
            axis = along_axis(self.robot, k)
            twists.append((k + 1, axis[:, None] * columns[:, None, :]))
        return tuple(twists)

    def _turned(self, k: int, R: Array, q: Array) -> Array:
        """D dq_k / d product, shape (m, products)."""
        robot = self.robot
        axis = rotate(R[:, k + 1], robot.axes[k])  # the joint's own motion leaves its axis in place
        if robot.prismatic[k]:
            return (axis @ self.down)[:, None]
        columns = []
        for j in robot.beyond(k):
            if robot.prismatic[j]:
                moments = robot.axes[j] * q[:, j, None, None]
            else:
                moments = across(robot.axes[j])[None]
            in_base = rotate(R[:, j + 1, None], moments)
            columns.append(np.sum(axis[:, None, :] * cross(in_base, self.down), axis=-1))
        return np.concatenate(columns, axis=1)
