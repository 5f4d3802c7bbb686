"""The accuracy to expect at each target, in records and as a figure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from studies.record import Entry, Maybe, Number

if TYPE_CHECKING:
    from calib.arm.robot import Robot
    from calib.arrays import Array
    from calib.poses import Poses
    from studies.plots.style import Picture

_MM = 1e3


class TargetAccuracy(Entry):
    """Where a target puts the tip (nominal model, base frame), and the error expected there.

    expanded_mm : within which 95 % of errors stay there
    """

    tip_x_mm: Number
    tip_y_mm: Number
    tip_z_mm: Number
    expected_mm: Maybe
    expanded_mm: Maybe = None


def at_targets(
    robot: Robot, targets: Poses, errors: Array, expanded: Array | None = None
) -> tuple[TargetAccuracy, ...]:
    """The entries of all targets.

    errors, expanded : ndarray, shape (m,), m, infinite where a parameter is open
    """
    from calib.arm.kinematics import forward

    tips = forward(robot, targets.q).o[:, -1] * _MM
    covered = np.full(len(tips), np.nan) if expanded is None else expanded
    return tuple(
        TargetAccuracy(
            tip_x_mm=x, tip_y_mm=y, tip_z_mm=z, expected_mm=error * _MM, expanded_mm=most * _MM
        )
        for (x, y, z), error, most in zip(
            tips.tolist(), errors.tolist(), covered.tolist(), strict=True
        )
    )


def over_the_workspace(rows: Sequence[TargetAccuracy]) -> Picture:
    """The error that the parameters' uncertainty leaves, where the tip is at the targets."""
    from studies.plots.accuracy import workspace

    tips = np.array([[row.tip_x_mm, row.tip_y_mm, row.tip_z_mm] for row in rows])
    errors = [np.inf if row.expected_mm is None else row.expected_mm for row in rows]
    return workspace(tips / _MM, np.array(errors) / _MM)
