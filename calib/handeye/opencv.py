"""Hand-eye calibration by the five methods that OpenCV has, as easy_handeye and MoveIt use them.

R. Tsai, R. Lenz (1989); F. Park, B. Martin (1994); R. Horaud, F. Dornaika (1995); N. Andreff,
R. Horaud, B. Espiau (1999); K. Daniilidis (1999). They solve ``A X = X B`` for the camera alone.
"""

from __future__ import annotations

from typing import Literal, TypeAlias

import numpy as np

from calib.arm.se3 import nearest_rotation, transform
from calib.arrays import Array

Method: TypeAlias = Literal[
    "arm as it is", "arm calibrated", "Tsai", "Park", "Horaud", "Andreff", "Daniilidis"
]
"""Ours, and OpenCV's."""
METHODS: tuple[Method, ...] = ("Tsai", "Park", "Horaud", "Andreff", "Daniilidis")
_SILENT = 0
_NO_ROTATION = 1e-3
_INSTALL = "pip install 'opencv-python-headless!=5.0.0.93'"


def missing() -> str:
    """Why there are no methods of OpenCV, and what to install; empty where they are there."""
    try:
        import cv2
    except ImportError:
        return f"OpenCV's five methods are left out, as it is not installed: {_INSTALL}"
    if not hasattr(cv2, "calibrateHandEye"):
        return (
            f"OpenCV's five methods are left out: OpenCV {cv2.__version__} lacks them. {_INSTALL}"
        )
    return ""


def hand_eye_by(method: Method, carried: Array, seen: Array) -> Array | None:
    """E, shape (4, 4), from F and C, both of shape (n, 4, 4); None where the method finds none."""
    import cv2

    solve = vars(cv2)["calibrateHandEye"]  # which stubs of a version without it do not know
    number = getattr(cv2, f"CALIB_HAND_EYE_{method.upper()}")
    R_F, R_C = ([*T[:, :3, :3]] for T in (carried, seen))
    t_F, t_C = ([*T[:, :3, 3:]] for T in (carried, seen))
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(_SILENT)  # what fails is told by its result
    try:
        R, t = solve(R_F, t_F, R_C, t_C, method=number)
    except cv2.error:
        return None
    finally:
        cv2.utils.logging.setLogLevel(level)
    sound = np.isfinite(R).all() and np.isfinite(t).all()
    gave_up = np.array_equal(R, np.eye(3)) and not np.any(t)  # Tsai, of too little motion
    if not sound or gave_up or np.abs(R @ R.T - np.eye(3)).max() > _NO_ROTATION:
        return None
    return transform(nearest_rotation(np.asarray(R)), np.ravel(t))
