"""What benchmarks of cameras share: frames, OpenCV's pixels, and poses that show whole boards."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from calib import Cell
from calib.arrays import Array
from doe.constraints import scene_of, visible
from doe.views import NUMBERS, looking, views_of

_AT_ONCE = 250  # candidates


def frame(position: ArrayLike, R: Array) -> Array:
    """A transform (4, 4), m."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, position
    return T


def standing(position: ArrayLike, rpy_deg: Sequence[float]) -> Array:
    """A transform (4, 4) by turns about the fixed x, y and z."""
    return frame(position, Rotation.from_euler("xyz", rpy_deg, degrees=True).as_matrix())


def corners(across: int, down: int, pitch: float) -> Array:
    """Inner corners of a chessboard in its frame, (n, 3), row by row."""
    grid = [[x, y, 0.0] for y in range(1, down + 1) for x in range(1, across + 1)]
    return np.array(grid) * pitch


def pixels(
    points: Array, T: Array, focal: ArrayLike, center: ArrayLike, bent: ArrayLike = (0.0,) * 5
) -> Array:
    """OpenCV's pixels (n, 2) of points (n, 3) that stand at T in camera axes.

    focal, center : px, of both axes or each; bent : distortion
    """
    import cv2

    K = np.eye(3)
    K[[0, 1], [0, 1]], K[:2, 2] = focal, center
    turn = cv2.Rodrigues(T[:3, :3])[0]
    uv, _ = cv2.projectPoints(points, turn, T[:3, 3], K, np.asarray(bent, dtype=float))
    return np.asarray(uv[:, 0])


def poses_that_show(
    cell: Cell, rng: np.random.Generator, drawn: int, count: int | None = None
) -> Array:
    """Joint values (n, dof), rad or m, at which all that cameras look at is seen.

    drawn : candidates; count : poses to end with, all that are found where None
    """
    low, high = cell.robot.sample_limits().T
    q = rng.uniform(low, high, (drawn, cell.robot.dof))
    even, free = rng.uniform(size=(drawn, NUMBERS)), np.ones(cell.robot.dof, dtype=bool)
    view = np.arange(drawn) % len(views_of(cell))
    found = q[:0]
    for first in range(0, drawn, _AT_ONCE):
        own = slice(first, first + _AT_ONCE)
        there = looking(cell, q[own], view[own], even[own], free)
        found = np.concatenate([found, there[visible(scene_of(cell, there)).all(axis=1)]])
        if count is not None and len(found) >= count:
            break
    return found[:count]
