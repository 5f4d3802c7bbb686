"""Photographs of a printed board, by OpenCV's homography of the print."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from calib.arrays import Array
from tests import camera_days

cv2 = pytest.importorskip("cv2", exc_type=ImportError)
SIZE = (960, 720)
FOCAL = 1000.0  # px
CENTER = ((SIZE[0] - 1) / 2.0, (SIZE[1] - 1) / 2.0)  # pixels have their centres at whole numbers
DOTS = 3000.0  # of a print, a metre
MARGIN = 90  # dots of white around it
CHARUCO = "squares = [9, 6]\npitch_mm = 30\nmarker_mm = 22"


def charuco() -> Any:
    words = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    board = cv2.aruco.CharucoBoard((9, 6), 0.03, 0.022, words)
    side = int(0.03 * DOTS)
    return board.generateImage((9 * side, 6 * side), marginSize=0)


def points_of() -> Array:
    """Where the print has its points (n, 3), m."""
    return camera_days.corners(8, 5, 0.03)


def pixels(points: Array, T: Array) -> Array:
    """Of points (n, 3), m, of a board at T in camera axes."""
    return camera_days.pixels(points, T, FOCAL, CENTER)


def facing(turn: float, tilt: tuple[float, float], size: tuple[float, float], away: float) -> Array:
    """A board (4, 4) in camera axes: turned in its plane, tilted, its middle before the camera."""
    R = cv2.Rodrigues(np.array([*tilt, 0.0]))[0] @ cv2.Rodrigues(np.array([0.0, 0.0, turn]))[0]
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, np.array([0.0, 0.0, away]) - R @ [size[0] / 2.0, size[1] / 2.0, 0.0]
    return T


def photograph(drawn: Any, T: Array) -> Any:
    """A print with its margin, its first dot at the board's origin, seen at T."""
    paper = cv2.copyMakeBorder(drawn, *[MARGIN] * 4, cv2.BORDER_CONSTANT, value=255)
    height, width = paper.shape
    dots = np.array([[0, 0], [width, 0], [width, height], [0, height]]) - 0.5
    there = np.c_[(dots + 0.5 - MARGIN) / DOTS, np.zeros(4)]
    H, _ = cv2.findHomography(dots, 3.0 * (pixels(there, T) + 0.5) - 0.5)
    large = cv2.warpPerspective(paper, H, (3 * SIZE[0], 3 * SIZE[1]), borderValue=90)
    return cv2.resize(large, SIZE, interpolation=cv2.INTER_AREA)
