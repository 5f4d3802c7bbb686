"""Poses of bodies as text: position in millimetres, and unit quaternion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from calib.arm.se3 import transform
from calib.arrays import Array

WRITTEN = ("x_mm", "y_mm", "z_mm", "qw", "qx", "qy", "qz")
NAMES = "{pose}::{marker}"
OFF_UNIT = 1e-3
"""How far the length of a quaternion may be from one: files round to a few digits."""


def pose_texts(T: Array) -> tuple[str, ...]:
    """The text of a frame (4, 4), m."""
    x, y, z, w = Rotation.from_matrix(T[:3, :3]).as_quat(canonical=True)
    place = (f"{1e3 * v:.6f}" for v in T[:3, 3])
    return (*place, *(f"{v + 0.0:.10f}" for v in (w, x, y, z)))


def pose_of_texts(values: Sequence[str]) -> Array:
    """The frame (4, 4), m, of such a text."""
    x, y, z, *quaternion = (float(v) for v in values)
    return frame_of([x * 1e-3, y * 1e-3, z * 1e-3], quaternion)


def frame_of(position: Sequence[float], quaternion: Sequence[float]) -> Array:
    """A frame (4, 4) from a position and a quaternion w, x, y, z."""
    w, *v = quaternion
    return transform(Rotation.from_quat([*v, w]).as_matrix(), np.array(position))
