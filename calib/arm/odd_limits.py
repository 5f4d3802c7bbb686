"""Joint limits that are numbers of another unit: degrees for radians, millimetres for metres."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from calib.arm.robot import Robot

_LONGEST = 50.0  # m, of a slide; the longest tracks of robots are shorter
_MOST_TURNS = 12.0  # of a joint that is not endless


def odd_limits(robot: Robot) -> Iterator[str]:
    """What is odd about the limits of each joint, and what to do."""
    for joint, slides, (low, high) in zip(robot.joints, robot.prismatic, robot.limits, strict=True):
        wide, span = float(high - low), f"{low:g} .. {high:g}"
        if not np.isfinite(wide):
            continue
        if slides and wide > _LONGEST:
            yield (
                f"the limits of {joint}, {span} m, are too far apart for a slide: were "
                "degrees or mm written? write metres in the robot's file, or give [robot.limits_mm]"
            )
        elif not slides and wide > 2.0 * np.pi * _MOST_TURNS:
            yield (
                f"the limits of {joint}, {span} rad, are {wide / (2.0 * np.pi):.0f} turns: "
                "were degrees written? write radians in the robot's file, or give [robot.limits_deg]"
            )
