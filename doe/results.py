"""Joint values in the units of the file formats."""

from __future__ import annotations

import math

from calib.arm.robot import Robot
from calib.arrays import Array

_MM = 1e3


def joint_fields(robot: Robot, q: Array) -> dict[str, dict[str, float]]:
    """Joint values by name: ``joints_deg``, and ``joints_mm`` where some slide."""
    found: dict[str, dict[str, float]] = {"joints_deg": {}}
    for joint, slides, value in zip(robot.joints, robot.prismatic, q, strict=True):
        key, shown = ("joints_mm", value * _MM) if slides else ("joints_deg", math.degrees(value))
        found.setdefault(key, {})[joint] = round(float(shown), 6) + 0.0
    return found
