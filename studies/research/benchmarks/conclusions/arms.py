"""The arms of the days: those of the sealed cases, of the benchmarks, and a UR-like one on a track."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from studies.research.benchmarks.day import SCARA, SEVEN
from studies.research.withheld.robots import HEAVY, LIGHT, RAIL, Arm, Joint, Triple


def _turning(
    name: str, xyz: Triple, axis: Triple, degrees: tuple[float, float], mass: float, com: Triple
) -> Joint:
    low, high = np.radians(degrees)
    return Joint(name, xyz, axis, float(low), float(high), mass, com)


UR_ON_TRACK = Arm(
    "ur_on_track",
    "rail",
    "tool0",
    (
        Joint("track", (0, 0, 0.30), (0, 1, 0), -1.0, 1.0, 40.0, (0, 0, 0.05), slides=True),
        _turning("shoulder_pan", (0, 0, 0.1273), (0, 0, 1), (-180, 180), 7.8, (0, 0.02, 0)),
        _turning("shoulder_lift", (0, 0.2209, 0), (0, 1, 0), (-175, -5), 12.9, (0.31, 0, 0)),
        _turning("elbow", (0.612, -0.1719, 0), (0, 1, 0), (-150, 150), 3.9, (0.29, 0, 0)),
        _turning("wrist_1", (0.5723, 0, 0), (0, 1, 0), (-180, 180), 2.0, (0, 0.01, 0)),
        _turning("wrist_2", (0, 0.1149, 0), (0, 0, -1), (-180, 180), 2.0, (0, 0.01, 0)),
        _turning("wrist_3", (0, 0, -0.1157), (0, 1, 0), (-180, 180), 0.4, (0, 0.02, 0)),
    ),
    (0, 0.0922, 0),
    (-1.570796, 0, 0),
    sigma=15e-6,
    load=0.0,
    tool=0.12,
    largest=2e-3,
    payload=0.0,
)  # lengths and masses of a UR10

_OPEN = {
    arm.name: replace(arm, spring=None)  # these days have no balancing spring
    for arm in (LIGHT, HEAVY, RAIL, SEVEN, SCARA, UR_ON_TRACK)
}
KINDS = ("light", "seven", "scara", "heavy")
"""6R of 1.3 m, 7R, SCARA and 6R of 2.7 m."""


def arm_of(name: str) -> Arm:
    """By its name, without a balancing spring."""
    return _OPEN[name]
