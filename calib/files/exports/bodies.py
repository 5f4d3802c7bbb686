"""Poses of bodies as text: position in millimetres, and unit quaternion."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from calib.arm.se3 import so3_exp, so3_log
from calib.arrays import Array

WRITTEN = ("x_mm", "y_mm", "z_mm", "qw", "qx", "qy", "qz")
NAMES = "{pose}::{marker}"
OFF_UNIT = 1e-3
"""How far the length of a quaternion may be from one: files round to a few digits."""


def pose_texts(T: Array) -> tuple[str, ...]:
    """The text of a frame (4, 4), m."""
    r = so3_log(T[:3, :3])
    half = float(np.linalg.norm(r)) / 2.0
    quaternion = [math.cos(half), *(r / 2.0 * np.sinc(half / np.pi))]
    return (*(f"{1e3 * v:.6f}" for v in T[:3, 3]), *(f"{v + 0.0:.10f}" for v in quaternion))


def pose_of_texts(values: Sequence[str]) -> Array:
    """The frame (4, 4), m, of such a text."""
    x, y, z, *quaternion = (float(v) for v in values)
    return frame_of([x * 1e-3, y * 1e-3, z * 1e-3], quaternion)


def frame_of(position: Sequence[float], quaternion: Sequence[float]) -> Array:
    """A frame (4, 4) from a position and a quaternion w, x, y, z."""
    w, *v = (q / math.hypot(*quaternion) for q in quaternion)
    sine = math.hypot(*v)
    angle = 2.0 * math.atan2(sine, w)
    T = np.eye(4)
    T[:3, :3] = so3_exp(np.array(v) / (sine or 1.0) * angle)
    T[:3, 3] = position
    return T
