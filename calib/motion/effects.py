"""What adds to the torque of a joint beyond the rigid links that its file describes.

Each kind is one class: the columns that its parameters multiply, what else looks alike, and what MJCF
and URDF call it. A new law of friction is one such class and one entry in ``KINDS``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from calib.arm.robot import Robot
from calib.arrays import Array
from calib.motion.filtering import SLOW, Samples

_DISTANCES = (300.0, 1e3, 3e3, 1e4, 3e4)  # 1/rad


@dataclass(frozen=True, eq=False)
class MotionState:
    """What columns may depend on.

    rigid : ndarray, shape (m, n), N m or N, torque of the links as the robot's file has them
    ratio : dict, joint -> turns of the motor for one of the joint, where the cell states it
    """

    robot: Robot
    samples: Samples
    rigid: Array
    ratios: dict[str, float]

    def sign(self, joint: int) -> Array:
        """Direction of motion, shape (m,), smooth about standstill."""
        return np.asarray(np.tanh(self.samples.v[:, joint] / SLOW))


class MotionEffect(ABC):
    """A term of the torque of one joint, linear in its parameters.

    unknowns : names of the parameters and their units where the joint turns and the effort is a torque
    variants : values of what is not linear, of which the best is chosen
    imitates : kinds that may look alike
    mjcf, urdf : attribute of a joint that holds it, empty where none does
    """

    kind: ClassVar[str]
    unknowns: ClassVar[tuple[tuple[str, str], ...]]
    variants: ClassVar[tuple[float, ...]] = (0.0,)
    imitates: ClassVar[tuple[str, ...]] = ()
    mjcf: ClassVar[str] = ""
    urdf: ClassVar[str] = ""

    @classmethod
    def acts(cls, robot: Robot, ratios: dict[str, float], joint: int) -> bool:
        """Whether it can act at a joint."""
        return True

    @staticmethod
    @abstractmethod
    def columns(state: MotionState, joint: int, variant: float) -> Array:
        """D torque / d parameter, shape (m, k), SI."""


class TorqueOffset(MotionEffect):
    """A constant torque, or current, of the sensor."""

    kind = "torque_offset"
    unknowns = (("offset", "Nm"),)
    imitates = ("spring", "inertials")

    @staticmethod
    def columns(state: MotionState, joint: int, variant: float) -> Array:
        return np.ones((len(state.samples), 1))


class CoulombFriction(MotionEffect):
    """Friction that only the direction of motion decides."""

    kind = "coulomb_friction"
    unknowns = (("friction", "Nm"),)
    imitates = ("pre_sliding", "load_friction")
    mjcf, urdf = "frictionloss", "friction"

    @staticmethod
    def columns(state: MotionState, joint: int, variant: float) -> Array:
        return state.sign(joint)[:, None]


class ViscousFriction(MotionEffect):
    """Friction in proportion to speed."""

    kind = "viscous_friction"
    unknowns = (("damping", "Nm s/rad"),)
    imitates = ("stribeck_friction",)
    mjcf, urdf = "damping", "damping"

    @staticmethod
    def columns(state: MotionState, joint: int, variant: float) -> Array:
        return state.samples.v[:, joint, None]


class StribeckFriction(MotionEffect):
    """Friction with the square root of speed: what bends its curve at low speed."""

    kind = "stribeck_friction"
    unknowns = (("friction", "Nm s^0.5/rad^0.5"),)
    imitates = ("viscous_friction", "coulomb_friction")

    @staticmethod
    def columns(state: MotionState, joint: int, variant: float) -> Array:
        speed = np.abs(state.samples.v[:, joint])
        return (state.sign(joint) * np.sqrt(speed))[:, None]


class PreSliding(MotionEffect):
    """Friction that builds up over a distance after each reversal (Dahl, 1968).

    ``dz/dt = sigma v (1 - z sgn v)``; between reversals ``z = s - (s - z_0) exp(-sigma |q - q_0|)``.
    """

    kind = "pre_sliding"
    unknowns = (("friction", "Nm"),)
    variants = _DISTANCES
    imitates = ("coulomb_friction", "torque_delay")

    @staticmethod
    def columns(state: MotionState, joint: int, variant: float) -> Array:
        return presliding(state.samples.q[:, joint], variant)[:, None]


def presliding(q: Array, sigma: float) -> Array:
    """State z (m,) of Dahl's friction along joint values (m,), zero at first; sigma : 1/rad."""
    step = np.diff(q, prepend=q[0])
    direction = np.sign(step)
    begins = np.flatnonzero(np.diff(direction, prepend=np.nan) != 0.0)
    way, z, last = np.cumsum(np.abs(step)), np.zeros(len(q)), 0.0
    for begin, end in zip(begins, [*begins[1:], len(q)], strict=True):
        s, before = direction[begin], way[begin - 1] if begin else 0.0
        z[begin:end] = s - (s - last) * np.exp(-sigma * (way[begin:end] - before)) if s else last
        last = z[end - 1]
    return z


class LoadFriction(MotionEffect):
    """Friction that grows with the torque that the gear transmits."""

    kind = "load_friction"
    unknowns = (("share", "Nm/Nm"),)
    imitates = ("coulomb_friction", "torque_scale")

    @staticmethod
    def columns(state: MotionState, joint: int, variant: float) -> Array:
        return (np.abs(state.rigid[:, joint]) * state.sign(joint))[:, None]


class Armature(MotionEffect):
    """Inertia of the rotor, seen through the gear."""

    kind = "armature"
    unknowns = (("inertia", "kg m^2"),)
    imitates = ("inertials",)
    mjcf = "armature"

    @staticmethod
    def columns(state: MotionState, joint: int, variant: float) -> Array:
        return state.samples.a[:, joint, None]


class Spring(MotionEffect):
    """A torque that the angle of the joint decides: a spring, a cable, a counterbalance."""

    kind = "spring"
    unknowns = (("sin", "Nm"), ("cos", "Nm"))
    imitates = ("inertials", "torque_offset")

    @staticmethod
    def columns(state: MotionState, joint: int, variant: float) -> Array:
        q = state.samples.q[:, joint]
        return np.column_stack([np.sin(q), np.cos(q)])


class TorqueRipple(MotionEffect):
    """A torque that repeats with each turn of the motor, and twice in it."""

    kind = "torque_ripple"
    unknowns = (("cos_1", "Nm"), ("sin_1", "Nm"), ("cos_2", "Nm"), ("sin_2", "Nm"))

    @classmethod
    def acts(cls, robot: Robot, ratios: dict[str, float], joint: int) -> bool:
        return robot.joints[joint] in ratios

    @staticmethod
    def columns(state: MotionState, joint: int, variant: float) -> Array:
        turned = state.ratios[state.robot.joints[joint]] * state.samples.q[:, joint]
        return np.column_stack([f(n * turned) for n in (1, 2) for f in (np.cos, np.sin)])


class TorqueDelay(MotionEffect):
    """Torques that are stamped later than angles."""

    kind = "torque_delay"
    unknowns = (("delay", "s"),)
    imitates = ("pre_sliding",)

    @staticmethod
    def columns(state: MotionState, joint: int, variant: float) -> Array:
        return -state.samples.slope[:, joint, None]


KINDS: tuple[type[MotionEffect], ...] = (
    *(TorqueOffset, CoulombFriction, ViscousFriction, Armature, PreSliding, LoadFriction),
    *(StribeckFriction, Spring, TorqueRipple, TorqueDelay),
)
"""All terms of single joints, in the order in which a ladder climbs."""
EFFECTS = {own.kind: own for own in KINDS}
PAYLOAD, INERTIALS, SCALE = "payload", "inertials", "torque_scale"
"""Terms of the torque that are no columns: ten parameters of the last link, of all links, and a factor
of the torque."""
NAMES = (*EFFECTS, PAYLOAD, INERTIALS, SCALE)


def parted(effects: Sequence[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """What ``[model] effects`` names of poses, and of motions; a payload belongs to both."""
    named = [(text, text.partition(":")[0].strip()) for text in effects]
    poses = tuple(text for text, name in named if name == PAYLOAD or name not in NAMES)
    return poses, tuple(text for text, name in named if name in NAMES)
