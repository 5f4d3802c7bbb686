"""Results in the units of the file formats: millimetres, microradians, names that people read."""

from __future__ import annotations

from calib.arm.kinematics import forward
from calib.arm.robot import Robot
from calib.arrays import Array
from calib.poses import Poses

_MM = 1e3


def at_targets(robot: Robot, targets: Poses, errors: Array) -> list[dict[str, float]]:
    """Where each target puts the tip (nominal model, base frame), and the error expected there.

    errors : ndarray, shape (m,), m
    """
    tips = forward(robot, targets.q).o[:, -1] * _MM
    return [
        {"tip_x_mm": x, "tip_y_mm": y, "tip_z_mm": z, "expected_mm": error * _MM}
        for (x, y, z), error in zip(tips.tolist(), errors.tolist(), strict=True)
    ]
