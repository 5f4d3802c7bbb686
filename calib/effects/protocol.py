"""What an effect is: anything that moves a marker, linear in its parameters where it acts.

An effect acts at one of four places of the paper's product ``T_base T_robot T_tool`` (equation 6):

- :class:`TwistEffect`: displaces a frame of the arm by ``xi = basis(state) @ parameters``;
- :class:`ElasticEffect`: a twist whose basis is a flexibility times the wrench that the frame
  transmits, ``xi = K(parameters) w`` (equation 2 with the terms of k_theta it stands for);
- :class:`LoadEffect`: adds to the wrench that frames transmit, and so moves what is elastic;
- :class:`~calib.effects.base.Base` and :class:`~calib.effects.tool.Tool`: the outer factors.

From the basis follow, in :mod:`calib.model`, the exact displacement, its Jacobian and its score.
A new cause of error is one file with one such class and one entry in ``calib.effects.EFFECTS``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar, Self

import numpy as np

from calib.errors import EffectCannotAct
from calib.kinematics import Frames
from calib.poses import Poses
from calib.robot import Robot
from calib.se3 import Array
from calib.statics import Transmitted


@dataclass(frozen=True)
class Parameter:
    """One unknown of the model.

    effect, where, name : str, as in the effect table of the file formats
    unit : str, in which people read it
    scale : float, SI per unit
    size : float, SI, a plausible magnitude: scales columns and nothing else
    """

    effect: str
    where: str
    name: str
    unit: str
    scale: float
    size: float

    @property
    def id(self) -> str:
        """Name that is unique in a model, ``effect:where.name``."""
        return f"{self.effect}:{self.where}.{self.name}"


@dataclass(frozen=True, eq=False)
class State:
    """What bases may depend on, at the present displacement of the arm."""

    poses: Poses
    frames: Frames
    wrench: Transmitted


@dataclass(frozen=True, eq=False)
class Context:
    """What an effect may ask for when it is placed.

    robot : Robot
    markers : ndarray, shape (M, 3), m, first guesses in the tip frame
    marker_names, stations : tuple of str
    knots : dict, joint name -> ndarray, rad, where ``stiffness_vs_angle`` has coefficients
    anchors : dict, joint name -> ndarray, shape (2, 3), m: spring anchors of a gravity
        compensator, on the link before the joint and on the link after it
    """

    robot: Robot
    markers: Array
    marker_names: tuple[str, ...]
    stations: tuple[str, ...] = ("base",)
    knots: Mapping[str, Array] = field(default_factory=dict)
    anchors: Mapping[str, Array] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Effect(ABC):
    """One cause at one place, ``where``."""

    where: str
    kind: ClassVar[str]

    @classmethod
    @abstractmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        """Every place where this effect can act on the robot at hand."""

    @classmethod
    @abstractmethod
    def at(cls, context: Context, where: str) -> Self:
        """The effect at one of its places."""

    @property
    @abstractmethod
    def parameters(self) -> tuple[Parameter, ...]:
        """Its unknowns, in the order of the basis columns."""


@dataclass(frozen=True, eq=False)
class TwistEffect(Effect):
    """Displaces ``frame`` (0 base, 1..n joints, n + 1 tip) in the frame's own axes."""

    frame: int

    @abstractmethod
    def basis(self, state: State) -> Array:
        """D xi / d parameter, shape (..., m or 1, 6, p), SI."""


@dataclass(frozen=True, eq=False)
class Constant(TwistEffect):
    """A displacement that is the same at every pose: it can go into the joint origins of a URDF."""

    @property
    @abstractmethod
    def columns(self) -> Array:
        """D xi / d parameter, shape (6, p), SI."""

    def basis(self, state: State) -> Array:
        return self.columns[None]


@dataclass(frozen=True, eq=False)
class ConstantTwist(Constant):
    """Single components of a constant displacement."""

    components: tuple[int, ...] = tuple(range(6))
    names: ClassVar[tuple[str, ...]] = ("x", "y", "z", "rx", "ry", "rz")

    @property
    def columns(self) -> Array:
        return np.eye(6)[:, list(self.components)]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return tuple(
            Parameter(self.kind, self.where, self.names[c], "um" if c < 3 else "urad", 1e-6, 1e-3)
            for c in self.components
        )

    def only(self, kept: tuple[int, ...]) -> Self:
        """The same with some of its parameters, given by their positions."""
        return replace(self, components=tuple(self.components[i] for i in kept))


@dataclass(frozen=True, eq=False)
class ElasticEffect(TwistEffect):
    """A displacement in proportion to the wrench that the frame transmits."""

    @abstractmethod
    def flexibility(self, poses: Poses) -> Array:
        """D K / d parameter, shape (m or 1, 6, 6, p): xi = K (force, moment) in the frame's axes."""

    def basis(self, state: State) -> Array:
        local = state.wrench.local[..., self.frame, :]
        K = self.flexibility(state.poses)
        K = np.broadcast_to(K, (len(state.poses), *K.shape[1:]))
        twists: Array = np.einsum("mijp,...mj->...mip", K, local, optimize=True)
        return twists


@dataclass(frozen=True, eq=False)
class AlongJoint(TwistEffect):
    """A twist along the variable of one joint: an error of its reading, or of its drive.

    axis : ndarray, shape (6,), unit displacement along the joint's variable
    """

    axis: Array

    @classmethod
    def places(cls, context: Context) -> tuple[str, ...]:
        return context.robot.joints

    @classmethod
    def at(cls, context: Context, where: str) -> Self:
        joint = joint_index(context, where)
        return cls(where, joint + 1, along_axis(context.robot, joint))

    @property
    def slides(self) -> bool:
        """Whether the joint is prismatic."""
        return bool(self.axis[:3].any())


@dataclass(frozen=True, eq=False)
class ElasticDrive(AlongJoint, ElasticEffect):
    """A joint that yields along its own variable: ``dq = compliance * torque``.

    Paper, equation 2 with a diagonal k_theta.
    """

    @abstractmethod
    def shares(self, poses: Poses) -> Array:
        """What each parameter adds to the compliance at each pose, shape (m or 1, p)."""

    def flexibility(self, poses: Poses) -> Array:
        return np.outer(self.axis, self.axis)[:, :, None] * self.shares(poses)[:, None, None, :]

    def basis(self, state: State) -> Array:
        torque = state.wrench.local[..., self.frame, :] @ self.axis
        turned: Array = torque[..., None] * self.shares(state.poses)
        return self.axis[:, None] * turned[..., None, :]


@dataclass(frozen=True, eq=False)
class LoadEffect(Effect):
    """Adds a wrench to what the frames transmit."""

    @abstractmethod
    def wrench_basis(self, poses: Poses) -> Array:
        """D w / d parameter, shape (m, n + 2, 6, p), in the axes of each frame."""


def joint_index(context: Context, where: str) -> int:
    """Position of a joint in the chain."""
    return context.robot.joints.index(where)


def along_axis(robot: Robot, joint: int) -> Array:
    """Unit displacement along a joint's variable, shape (6,)."""
    part = slice(0, 3) if robot.prismatic[joint] else slice(3, 6)
    unit = np.zeros(6)
    unit[part] = robot.axes[joint]
    return unit


def revolute_joints(context: Context) -> tuple[str, ...]:
    """Names of the joints that turn."""
    robot = context.robot
    return tuple(j for j, slides in zip(robot.joints, robot.prismatic, strict=True) if not slides)


def compliance_unit(prismatic: bool) -> tuple[str, float, float]:
    """Unit of a joint's compliance, its SI scale, and a plausible size (light arms are soft)."""
    return ("nm/N", 1e-9, 1e-6) if prismatic else ("urad/(N m)", 1e-6, 1e-5)


def needs(context_has: bool, effect: str, reason: str, remedy: str) -> None:
    """Refuse an effect that lacks what it needs."""
    if not context_has:
        raise EffectCannotAct(effect, reason, remedy)
