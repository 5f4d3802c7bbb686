"""What adds to the torque of a joint beyond the rigid links that its file describes.

Each kind is one class: the columns that its parameters multiply, what else looks alike, and what MJCF
and URDF call it. A new law of friction is one such class and one entry in ``KINDS``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from calib.arm.robot import Robot
from calib.arrays import Array
from calib.effects.loads import spring_torques
from calib.motion.filtering import SLOW, Samples

_DISTANCES = (300.0, 1e3, 3e3, 1e4, 3e4)  # 1/rad


@dataclass(frozen=True, eq=False)
class Stated:
    """What a cell states of joints, by name.

    gear_ratio : turns of the motor for one of the joint
    compensators_mm : ndarray, shape (2, 3), m: anchors of the spring of a gravity compensator, on the
        link before the joint and on that after it, from the joint's origin
    """

    gear_ratio: Mapping[str, float] = field(default_factory=dict)
    compensators_mm: Mapping[str, Array] = field(default_factory=dict)

    def has(self, key: str, joint: str) -> bool:
        """Whether a key of [robot] is stated of a joint; an empty one is."""
        return not key or joint in getattr(self, key)


@dataclass(frozen=True, eq=False)
class JointMotion:
    """What the columns of a joint may depend on.

    q, v, a : ndarray, shape (m,), rad or m, and per second; slope : of the effort, a second
    rigid : ndarray, shape (m,), N m or N, torque of the links as the robot's file has them
    ratio : float, turns of the motor for one of the joint; NaN where the cell does not state it
    compensator : ndarray, shape (m, 2), torques by a unit of its spring and of its preload, none where
        the cell states no anchors
    """

    q: Array
    v: Array
    a: Array
    slope: Array
    rigid: Array
    ratio: float = np.nan
    compensator: Array = field(default_factory=lambda: np.zeros((0, 2)))

    @classmethod
    def of(
        cls, samples: Samples, rigid: Array, robot: Robot, joint: int, stated: Stated | None = None
    ) -> JointMotion:
        """Of one joint; rigid : ndarray, shape (m, n)."""
        stated, name = stated or Stated(), robot.joints[joint]
        q, v, a, slope, torque = (
            own[:, joint] for own in (samples.q, samples.v, samples.a, samples.slope, rigid)
        )
        found = cls(q, v, a, slope, torque, stated.gear_ratio.get(name, np.nan))
        if (anchors := stated.compensators_mm.get(name)) is None:
            return found
        return replace(found, compensator=spring_torques(robot.axes[joint], anchors, q))

    def sign(self, width: float = SLOW) -> Array:
        """Direction of motion, shape (m,), smooth within a speed about standstill, rad/s or m/s."""
        return np.asarray(np.tanh(self.v / width))


@dataclass(frozen=True)
class MotionEffect(ABC):
    """A term of the torque of one joint, linear in its parameters.

    variant : float, value of what is not linear, of which the best of ``variants`` is chosen
    unknowns : names of the parameters and their units where the joint turns and the effort is a torque
    needs : key of [robot] that must state something of the joint, empty where none must
    sharp : whether it changes faster than the effort's filter, so that its columns go through it too
    mjcf, urdf : attribute of a joint that holds it, empty where none does
    """

    variant: float = 0.0
    kind: ClassVar[str]
    unknowns: ClassVar[tuple[tuple[str, str], ...]]
    variants: ClassVar[tuple[float, ...]] = (0.0,)
    needs: ClassVar[str] = ""
    sharp: ClassVar[bool] = False
    mjcf: ClassVar[str] = ""
    urdf: ClassVar[str] = ""

    @abstractmethod
    def columns(self, joint: JointMotion) -> Array:
        """D torque / d parameter, shape (m, k), SI."""


@dataclass(frozen=True)
class TorqueOffset(MotionEffect):
    """A constant torque, or current, of the sensor."""

    kind = "torque_offset"
    unknowns = (("offset", "Nm"),)

    def columns(self, joint: JointMotion) -> Array:
        return np.ones((len(joint.q), 1))


@dataclass(frozen=True)
class CoulombFriction(MotionEffect):
    """Friction that the direction of motion decides, and the parts of it that turn with it slowly.

    Its curve about standstill is no cause: what is named beside must do more than bend it.
    """

    kind = "coulomb_friction"
    sharp = True
    unknowns = (("friction", "Nm"), ("within_6_mrad_s", "Nm"), ("within_20_mrad_s", "Nm"))
    mjcf, urdf = "frictionloss", "friction"

    def columns(self, joint: JointMotion) -> Array:
        sharp, *slow = (joint.sign(width) for width in (0.1 * SLOW, 0.3 * SLOW, SLOW))
        return np.column_stack([sharp, *(own - sharp for own in slow)])


@dataclass(frozen=True)
class ViscousFriction(MotionEffect):
    """Friction in proportion to speed."""

    kind = "viscous_friction"
    unknowns = (("damping", "Nm s/rad"),)
    mjcf, urdf = "damping", "damping"

    def columns(self, joint: JointMotion) -> Array:
        return joint.v[:, None]


@dataclass(frozen=True)
class StribeckFriction(MotionEffect):
    """Friction with the square root of speed: what bends its curve at low speed."""

    kind = "stribeck_friction"
    sharp = True
    unknowns = (("friction", "Nm s^0.5/rad^0.5"),)

    def columns(self, joint: JointMotion) -> Array:
        return (joint.sign() * np.sqrt(np.abs(joint.v)))[:, None]


@dataclass(frozen=True)
class PreSliding(MotionEffect):
    """Friction that builds up over a distance after each reversal (Dahl, 1968).

    ``dz/dt = sigma v (1 - z sgn v)``; between reversals ``z = s - (s - z_0) exp(-sigma |q - q_0|)``.
    """

    kind = "pre_sliding"
    sharp = True
    unknowns = (("friction", "Nm"),)
    variants = _DISTANCES

    def columns(self, joint: JointMotion) -> Array:
        return presliding(joint.q, self.variant)[:, None]


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


@dataclass(frozen=True)
class LoadFriction(MotionEffect):
    """Friction that grows with the torque that the gear transmits."""

    kind = "load_friction"
    sharp = True
    unknowns = (("share", "Nm/Nm"),)

    def columns(self, joint: JointMotion) -> Array:
        return (np.abs(joint.rigid) * joint.sign())[:, None]


@dataclass(frozen=True)
class Armature(MotionEffect):
    """Inertia of the rotor, seen through the gear."""

    kind = "armature"
    unknowns = (("inertia", "kg m^2"),)
    mjcf = "armature"

    def columns(self, joint: JointMotion) -> Array:
        return joint.a[:, None]


@dataclass(frozen=True)
class Spring(MotionEffect):
    """A torque that the angle of the joint decides: a spring, a cable, a counterbalance."""

    kind = "spring"
    unknowns = (("sin", "Nm"), ("cos", "Nm"))

    def columns(self, joint: JointMotion) -> Array:
        return np.column_stack([np.sin(joint.q), np.cos(joint.q)])


@dataclass(frozen=True)
class GravityCompensator(MotionEffect):
    """What a spring between two stated anchors bears, as of poses: the drive bears so much less."""

    kind = "gravity_compensator"
    needs = "compensators_mm"
    unknowns = (("spring", "N/m"), ("preload", "N"))

    def columns(self, joint: JointMotion) -> Array:
        return -joint.compensator


@dataclass(frozen=True)
class TorqueRipple(MotionEffect):
    """A torque that repeats with each turn of the motor, and twice in it."""

    kind = "torque_ripple"
    needs = "gear_ratio"
    sharp = True  # motors turn faster than the filter lets pass
    unknowns = (("cos_1", "Nm"), ("sin_1", "Nm"), ("cos_2", "Nm"), ("sin_2", "Nm"))

    def columns(self, joint: JointMotion) -> Array:
        turned = joint.ratio * joint.q
        return np.column_stack([f(n * turned) for n in (1, 2) for f in (np.cos, np.sin)])


@dataclass(frozen=True)
class TorqueDelay(MotionEffect):
    """Torques that are stamped later than angles."""

    kind = "torque_delay"
    unknowns = (("delay", "s"),)

    def columns(self, joint: JointMotion) -> Array:
        return -joint.slope[:, None]


KINDS: tuple[type[MotionEffect], ...] = (
    *(TorqueOffset, CoulombFriction, ViscousFriction, Armature, PreSliding, LoadFriction),
    *(StribeckFriction, Spring, GravityCompensator, TorqueRipple, TorqueDelay),
)
"""All terms of single joints, in the order in which a ladder climbs."""
EFFECTS = {own.kind: own for own in KINDS}
PAYLOAD, INERTIALS, SCALE = "payload", "inertials", "torque_scale"
"""Terms of the torque that are no columns: ten parameters of the last link, of all links, and a factor
of the torque."""
NAMES = (*EFFECTS, PAYLOAD, INERTIALS, SCALE)


def parted(
    effects: Sequence[str], sprung: Collection[str]
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """What ``[model] effects`` names of poses, and of motions.

    A payload belongs to both; so does a compensator, to motions at joints whose anchors are stated.

    sprung : these joints
    """
    poses, motions = list[str](), list[str]()
    for text in effects:
        name, _, where = (part.strip() for part in text.partition(":"))
        if name == GravityCompensator.kind:
            poses.append(text)
            asked = [own.strip() for own in where.split(",")] if where else sprung
            if places := [joint for joint in asked if joint in sprung]:
                motions.append(f"{name}:{','.join(places)}")
            continue
        if name == PAYLOAD or name not in NAMES:
            poses.append(text)
        if name in NAMES:
            motions.append(text)
    return tuple(poses), tuple(motions)
