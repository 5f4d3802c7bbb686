"""Arms of many sizes: 6R, 7R, 6R on a rail, SCARA and palletiser, none of which is met twice."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from studies.research.withheld.robots import HEAVY, LIGHT, RAIL, Arm, Joint, Triple

_HALF_TURN = 3.141593


def _turning(
    name: str,
    xyz: Triple,
    axis: Triple,
    limits: tuple[float, float],
    mass: float = 3.0,
    compliance: float = 0.0,
    com: Triple = (0.0, 0.02, 0.1),
) -> Joint:
    return Joint(name, xyz, axis, *limits, mass, com, compliance)


SEVEN = Arm(
    "seven",
    "base",
    "flange",
    (
        _turning("s1", (0, 0, 0.16), (0, 0, 1), (-2.9, 2.9), 4.0),
        _turning("s2", (0, 0, 0.20), (0, 1, 0), (-2.0, 2.0), 4.0, 1.2e-5),
        _turning("s3", (0, 0, 0.21), (0, 0, 1), (-2.9, 2.9), 3.0, 1.6e-5),
        _turning("e1", (0, 0, 0.21), (0, -1, 0), (-2.0, 2.0), 2.7, 2.0e-5),
        _turning("w1", (0, 0, 0.21), (0, 0, 1), (-2.9, 2.9), 1.7, 4.0e-5),
        _turning("w2", (0, 0, 0.19), (0, 1, 0), (-2.0, 2.0), 1.8, 4.0e-5),
        _turning("w3", (0, 0, 0.08), (0, 0, 1), (-3.0, 3.0), 0.3, 5.0e-5, (0.0, 0.01, 0.02)),
    ),
    (0, 0, 0.05),
    (0, 0, 0),
    sigma=12e-6,
    load=80.0,
    tool=0.12,
    largest=1.5e-3,
    payload=3.0,
)
SCARA = Arm(
    "scara",
    "base",
    "flange",
    (
        _turning("J1", (0, 0, 0.34), (0, 0, 1), (-2.27, 2.27), 6.0),
        _turning("J2", (0.325, 0, 0), (0, 0, 1), (-2.44, 2.44), 4.0),
        Joint("Z", (0.275, 0, 0), (0, 0, 1), -0.21, 0.0, 1.5, (0, 0, 0), slides=True),
        _turning("J4", (0, 0, 0), (0, 0, 1), (-3.1, 3.1), 0.3),
    ),
    (0, 0, -0.05),
    (_HALF_TURN, 0, 0),
    sigma=10e-6,
    load=30.0,
    tool=0.10,
    largest=1e-3,
    payload=1.5,
)
PALLET = Arm(
    "pallet",
    "base",
    "wrist",
    (
        _turning("A1", (0, 0, 0.70), (0, 0, 1), (-2.8, 2.8), 300.0),
        _turning("A2", (0.28, 0, 0), (0, 1, 0), (-1.6, 0.3), 160.0, 2.0e-7, (0.5, 0.0, 0.0)),
        _turning("A3", (1.10, 0, 0), (0, 1, 0), (-0.3, 1.9), 110.0, 3.0e-7, (0.4, 0.0, 0.0)),
        _turning("A4", (1.20, 0, 0), (0, 1, 0), (-1.8, 1.8), 20.0, 1.5e-6, (0.05, 0.02, 0.0)),
        _turning("A5", (0.20, 0, 0), (1, 0, 0), (-3.1, 3.1), 8.0, 2.0e-6, (0.02, 0.01, 0.0)),
    ),
    (0.05, 0, 0),
    (0, _HALF_TURN / 2, 0),
    sigma=15e-6,
    load=900.0,
    tool=0.25,
    largest=2.5e-3,
    payload=60.0,
)
MODELS = (HEAVY, LIGHT, RAIL, SEVEN, SCARA, PALLET)


def draw_arm(rng: np.random.Generator) -> Arm:
    """One of the models with lengths, masses, limits, drives and instrument of its own."""
    arm = MODELS[int(rng.integers(len(MODELS)))]
    scale = float(np.exp(rng.uniform(*np.log((0.75, 1.35)))))
    return replace(
        arm,
        joints=tuple(_grown(rng, joint, scale) for joint in arm.joints),
        tip_xyz=_shown(arm.tip_xyz, scale),
        sigma=round(float(rng.uniform(8e-6, 20e-6)), 7),
        tool=round(arm.tool * scale, 3),
        largest=arm.largest * scale,
        spring=None,
    )


def _grown(rng: np.random.Generator, joint: Joint, scale: float) -> Joint:
    low, high = joint.low, joint.high
    cut = rng.uniform(0.0, 0.12, 2) * (high - low)
    own = scale * float(rng.lognormal(0.0, 0.08))
    return replace(
        joint,
        xyz=_shown(joint.xyz, own),
        low=round(low + float(cut[0]), 6),
        high=round(high - float(cut[1]), 6),
        mass=round(joint.mass * float(rng.lognormal(0.0, 0.2)), 3),
        com=_shown(joint.com, scale),
        compliance=joint.compliance * float(rng.lognormal(0.0, 0.3)),
    )


def _shown(xyz: Sequence[float], scale: float) -> Triple:
    """Scaled, and rounded as the URDF shows it."""
    x, y, z = (round(float(v) * scale, 6) for v in xyz)
    return x, y, z
