"""Arms, written by hand or drawn anew: 6R heavy and light, 6R on a rail, 7R, SCARA and palletiser."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
Mask: TypeAlias = NDArray[np.bool_]
Triple: TypeAlias = tuple[float, float, float]


@dataclass(frozen=True)
class Joint:
    """A joint and the link that it moves.

    xyz, rpy : origin in the link before it, m and rad; axis : unit vector in the joint's frame
    low, high : limits, rad or m
    mass, com : kg of the link, and its centre in the link's frame, m
    compliance : rad/(N m), typical; 0 where no vertical load turns the joint
    """

    name: str
    xyz: Triple
    axis: Triple
    low: float
    high: float
    mass: float
    com: Triple
    compliance: float = 0.0
    rpy: Triple = (0.0, 0.0, 0.0)
    slides: bool = False


@dataclass(frozen=True)
class Arm:
    """A serial arm with its instrument and load.

    sigma : m, standard deviation of one coordinate
    load : N, hung at the tool; payload : kg, at most
    tool : m, distance of the markers from the tip
    largest : m, RMS displacement that an effect may cause at most
    spring : joint of a balancing spring with its anchors before and after it (m), or None
    """

    name: str
    base: str
    tip: str
    joints: tuple[Joint, ...]
    tip_xyz: Triple
    tip_rpy: Triple
    sigma: float
    load: float
    tool: float
    largest: float
    payload: float
    spring: tuple[str, Triple, Triple] | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the joints."""
        return tuple(joint.name for joint in self.joints)

    @property
    def dof(self) -> int:
        """Number of joints, n. Frames are 0 (base), 1..n (before each joint's motion), n + 1 (tip)."""
        return len(self.joints)

    @property
    def axes(self) -> Array:
        """Joint axes, shape (n, 3)."""
        return np.array([joint.axis for joint in self.joints])

    @property
    def slides(self) -> Mask:
        """Which joints are prismatic, shape (n,)."""
        return np.array([joint.slides for joint in self.joints])

    @property
    def limits(self) -> Array:
        """Lower and upper limits, shape (n, 2), rad or m."""
        return np.array([[joint.low, joint.high] for joint in self.joints])

    @property
    def masses(self) -> Array:
        """Masses of the links, shape (n,), kg."""
        return np.array([joint.mass for joint in self.joints])

    @property
    def turning(self) -> list[str]:
        """Names of the joints that turn."""
        return [joint.name for joint in self.joints if not joint.slides]

    @property
    def soft(self) -> list[str]:
        """Names of the joints that yield."""
        return [joint.name for joint in self.joints if joint.compliance]

    def shown(self, q: Array) -> Array:
        """Joints (.., n) in degrees and millimetres."""
        return np.where(self.slides, q * 1e3, np.degrees(q))

    def columns(self) -> list[str]:
        """Their columns in a table."""
        return [f"{joint.name}_{'mm' if joint.slides else 'deg'}" for joint in self.joints]


def _deg(low: float, high: float) -> tuple[float, float]:
    below, above = np.round(np.radians((low, high)), 6)
    return float(below), float(above)


HEAVY = Arm(
    "heavy", "base_link", "tool0",
    (
        Joint("A1", (0, 0, 0.72), (0, 0, -1), *_deg(-150, 150), 340, (0.09, 0, 0.02)),
        Joint("A2", (0.33, 0, 0), (0, 1, 0), *_deg(-128, -8), 235, (0.47, 0, -0.09), 0.14e-6),
        Joint("A3", (1.18, 0, 0), (0, 1, 0), *_deg(-85, 125), 182, (0.16, -0.06, 0.09), 0.40e-6),
        Joint("A4", (0.61, 0, -0.05), (-1, 0, 0), *_deg(-170, 170), 44, (0.19, 0, 0.01), 2.6e-6),
        Joint("A5", (0.51, 0, 0), (0, 1, 0), *_deg(-110, 110), 18, (0.06, 0, 0), 3.2e-6),
        Joint("A6", (0.11, 0, 0), (-1, 0, 0), *_deg(-170, 170), 7.5, (0.03, 0, 0), 2.2e-6),
    ),
    (0.14, 0, 0), (0, 1.570796, 0),
    sigma=15e-6, load=2400.0, tool=0.25, largest=3e-3, payload=60.0,
    spring=("A2", (-0.45, 0.0, 0.30), (0.52, 0.0, 0.16)),
)  # fmt: skip
LIGHT = Arm(
    "light", "base", "flange",
    (
        Joint("pan", (0, 0, 0.127), (0, 0, 1), *_deg(-180, 180), 7.2, (0, 0.02, 0)),
        Joint("lift", (0, 0.174, 0), (0, 1, 0), *_deg(-168, -12), 12.9, (0.30, 0.04, 0), 12e-6),
        Joint("elbow", (0.608, -0.128, 0), (0, 1, 0), *_deg(-140, 140), 4.4, (0.25, 0, 0), 14e-6),
        Joint("wrist_1", (0.569, 0, 0), (0, 1, 0), *_deg(-180, 180), 2.0, (0, 0.01, 0), 36e-6),
        Joint("wrist_2", (0, 0.115, 0), (0, 0, -1), *_deg(-170, 170), 2.0, (0, 0.01, 0), 40e-6),
        Joint("wrist_3", (0, 0, -0.117), (0, 1, 0), *_deg(-180, 180), 0.4, (0, 0, -0.02), 45e-6),
    ),
    (0, 0.094, 0), (-1.570796, 0, 0),
    sigma=12e-6, load=70.0, tool=0.10, largest=1.5e-3, payload=2.5,
)  # fmt: skip
RAIL = Arm(
    "rail", "track", "tcp",
    (
        Joint("rail", (0, 0, 0.42), (0, 1, 0), -1.3, 1.3, 190.0, (0.05, 0, 0.1), slides=True),
        Joint("joint_1", (0.02, 0, 0.35), (0, 0, 1), *_deg(-165, 165), 95, (0.05, 0, 0.1)),
        Joint("joint_2", (0.18, 0, 0.31), (0, 1, 0), *_deg(-85, 95), 52, (0.02, 0.05, 0.36), 1.6e-6),
        Joint("joint_3", (0, 0, 0.78), (0, 1, 0), *_deg(-150, 55), 41, (0.12, 0, 0.08), 2.2e-6),
        Joint("joint_4", (0.36, 0, 0.13), (1, 0, 0), *_deg(-170, 170), 14, (0.2, 0, 0.02), 11e-6),
        Joint("joint_5", (0.44, 0, 0), (0, 1, 0), *_deg(-115, 115), 7, (0.04, 0, 0), 14e-6),
        Joint("joint_6", (0.09, 0, 0), (1, 0, 0), *_deg(-175, 175), 2.2, (0.01, 0, 0), 12e-6),
    ),
    (0.06, 0, 0), (0, 1.570796, 0),
    sigma=20e-6, load=420.0, tool=0.16, largest=2e-3, payload=12.0,
    spring=("joint_2", (-0.22, 0.0, 0.05), (-0.06, 0.0, 0.42)),
)  # fmt: skip
ARMS = (HEAVY, LIGHT, RAIL)

_MIDDLE = (0.0, 0.02, 0.1)  # m, where a link's mass is
_HALF_TURN = 3.141593
SEVEN = Arm(
    "seven", "base", "flange",
    (
        Joint("s1", (0, 0, 0.16), (0, 0, 1), -2.9, 2.9, 4.0, _MIDDLE),
        Joint("s2", (0, 0, 0.20), (0, 1, 0), -2.0, 2.0, 4.0, _MIDDLE, 1.2e-5),
        Joint("s3", (0, 0, 0.21), (0, 0, 1), -2.9, 2.9, 3.0, _MIDDLE, 1.6e-5),
        Joint("e1", (0, 0, 0.21), (0, -1, 0), -2.0, 2.0, 2.7, _MIDDLE, 2.0e-5),
        Joint("w1", (0, 0, 0.21), (0, 0, 1), -2.9, 2.9, 1.7, _MIDDLE, 4.0e-5),
        Joint("w2", (0, 0, 0.19), (0, 1, 0), -2.0, 2.0, 1.8, _MIDDLE, 4.0e-5),
        Joint("w3", (0, 0, 0.08), (0, 0, 1), -3.0, 3.0, 0.3, (0.0, 0.01, 0.02), 5.0e-5),
    ),
    (0, 0, 0.05), (0, 0, 0),
    sigma=12e-6, load=80.0, tool=0.12, largest=1.5e-3, payload=3.0,
)  # fmt: skip
SCARA = Arm(
    "scara", "base", "flange",
    (
        Joint("J1", (0, 0, 0.34), (0, 0, 1), -2.27, 2.27, 6.0, _MIDDLE),
        Joint("J2", (0.325, 0, 0), (0, 0, 1), -2.44, 2.44, 4.0, _MIDDLE),
        Joint("Z", (0.275, 0, 0), (0, 0, 1), -0.21, 0.0, 1.5, (0, 0, 0), slides=True),
        Joint("J4", (0, 0, 0), (0, 0, 1), -3.1, 3.1, 0.3, _MIDDLE),
    ),
    (0, 0, -0.05), (_HALF_TURN, 0, 0),
    sigma=10e-6, load=30.0, tool=0.10, largest=1e-3, payload=1.5,
)  # fmt: skip
PALLET = Arm(
    "pallet", "base", "wrist",
    (
        Joint("A1", (0, 0, 0.70), (0, 0, 1), -2.8, 2.8, 300.0, _MIDDLE),
        Joint("A2", (0.28, 0, 0), (0, 1, 0), -1.6, 0.3, 160.0, (0.5, 0.0, 0.0), 2.0e-7),
        Joint("A3", (1.10, 0, 0), (0, 1, 0), -0.3, 1.9, 110.0, (0.4, 0.0, 0.0), 3.0e-7),
        Joint("A4", (1.20, 0, 0), (0, 1, 0), -1.8, 1.8, 20.0, (0.05, 0.02, 0.0), 1.5e-6),
        Joint("A5", (0.20, 0, 0), (1, 0, 0), -3.1, 3.1, 8.0, (0.02, 0.01, 0.0), 2.0e-6),
    ),
    (0.05, 0, 0), (0, _HALF_TURN / 2, 0),
    sigma=15e-6, load=900.0, tool=0.25, largest=2.5e-3, payload=60.0,
)  # fmt: skip
MODELS = (HEAVY, LIGHT, RAIL, SEVEN, SCARA, PALLET)


def draw_arm(rng: np.random.Generator) -> Arm:
    """One of the models with other lengths, masses, limits, drives and instrument."""
    arm = MODELS[int(rng.integers(len(MODELS)))]
    scale = float(np.exp(rng.uniform(*np.log((0.75, 1.35)))))
    return replace(
        arm,
        joints=tuple(_grown(rng, joint, scale) for joint in arm.joints),
        tip_xyz=_scaled(arm.tip_xyz, scale),
        sigma=round(float(rng.uniform(8e-6, 20e-6)), 7),
        tool=round(arm.tool * scale, 3),
        largest=arm.largest * scale,
        spring=None,
    )


def _grown(rng: np.random.Generator, joint: Joint, scale: float) -> Joint:
    cut = rng.uniform(0.0, 0.12, 2) * (joint.high - joint.low)
    length = scale * float(rng.lognormal(0.0, 0.08))
    return replace(
        joint,
        xyz=_scaled(joint.xyz, length),
        low=round(joint.low + float(cut[0]), 6),
        high=round(joint.high - float(cut[1]), 6),
        mass=round(joint.mass * float(rng.lognormal(0.0, 0.2)), 3),
        com=_scaled(joint.com, scale),
        compliance=joint.compliance * float(rng.lognormal(0.0, 0.3)),
    )


def _scaled(xyz: Sequence[float], scale: float) -> Triple:
    """Scaled, and rounded as the URDF shows it."""
    x, y, z = (round(float(v) * scale, 6) for v in xyz)
    return x, y, z
