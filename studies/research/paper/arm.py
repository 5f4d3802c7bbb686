"""The arm of the paper's section IV: three joints, equation (21)."""

from __future__ import annotations

import numpy as np

from calib.arm.robot import Robot
from calib.arm.se3 import transform
from calib.arrays import Array

LENGTHS_M = (1.0, 0.8, 0.6)
"""l_1, l_2, l_3 of the paper's simulation study [m]."""


def arm_of_equation_21(lengths: tuple[float, float, float] = LENGTHS_M) -> Robot:
    """The weightless arm of equation (21), its tip at the end of link 3 with x along the link.

    lengths : l_1, l_2, l_3 [m]

    Joint 1 turns about +z; joints 2 and 3 about -y, so that positive angles lift the links as in
    ``z = l_1 + l_2 sin q_2 + l_3 sin(q_2 + q_3)``. At q = 0 all frames are parallel to the base.

    >>> from calib.arm.kinematics import forward
    >>> frames = forward(arm_of_equation_21(), np.array([[0.0, 0.0, np.pi / 2]]))
    >>> [float(x) for x in frames.o[0, -1].round(9)]
    [0.8, 0.0, 1.6]
    """
    rise, upper, fore = lengths
    translations = np.array(
        [[0.0, 0.0, 0.0], [0.0, 0.0, rise], [upper, 0.0, 0.0], [fore, 0.0, 0.0]]
    )
    return Robot(
        name="arm of equation (21)",
        base="base",
        tip="tip",
        joints=("q1", "q2", "q3"),
        prismatic=np.zeros(3, dtype=bool),
        origins=_unturned(translations),
        axes=np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [0.0, -1.0, 0.0]]),
        limits=np.full((3, 2), [-np.pi, np.pi]),
        efforts=np.full(3, np.nan),
        masses=np.zeros(3),
        coms=np.zeros((3, 3)),
    )


def _unturned(translations: Array) -> Array:
    """Pure translations as transforms, shape (k, 3) m -> (k, 4, 4)."""
    return transform(np.broadcast_to(np.eye(3), (len(translations), 3, 3)), translations)
