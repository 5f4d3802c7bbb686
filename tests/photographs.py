"""Photographs of a printed board, by OpenCV's homography of the print."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from calib.arrays import Array

cv2 = pytest.importorskip("cv2", exc_type=ImportError)
SIZE = (960, 720)
FOCAL = 1000.0  # px
CENTER = ((SIZE[0] - 1) / 2.0, (SIZE[1] - 1) / 2.0)  # pixels have their centres at whole numbers
DOTS = 3000.0  # of a print, a metre
MARGIN = 90  # dots of white around it
SIDE = int(0.03 * DOTS)  # of a square
CHARUCO = "squares = [9, 6]\npitch_mm = 30\nmarker_mm = 22"


def charuco() -> Any:
    words = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    board = cv2.aruco.CharucoBoard((9, 6), 0.03, 0.022, words)
    return board.generateImage((9 * SIDE, 6 * SIDE), marginSize=0)


def points_of() -> Array:
    """Where the print has its points (n, 3), m."""
    return np.array([(0.03 * (x + 1), 0.03 * (y + 1), 0.0) for y in range(5) for x in range(8)])


def pixels(points: Array, T: Array) -> Array:
    """A pinhole's pixels (n, 2) of points (n, 3), m, of a board at T in camera axes."""
    own = points @ T[:3, :3].T + T[:3, 3]
    return np.asarray(FOCAL * own[:, :2] / own[:, 2:] + CENTER)


def facing(turn: float, tilt: tuple[float, float], size: tuple[float, float], away: float) -> Array:
    """A board (4, 4) in camera axes: turned in its plane, tilted, its middle before the camera."""
    R = cv2.Rodrigues(np.array([*tilt, 0.0]))[0] @ cv2.Rodrigues(np.array([0.0, 0.0, turn]))[0]
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, np.array([0.0, 0.0, away]) - R @ [size[0] / 2.0, size[1] / 2.0, 0.0]
    return T


def photograph(drawn: Any, T: Array) -> Any:
    """A print with its margin, its first dot at the board's origin, seen at T."""
    paper = cv2.copyMakeBorder(drawn, *[MARGIN] * 4, cv2.BORDER_CONSTANT, value=255)
    there = T.copy()
    there[:3, 3] -= T[:3, :3] @ [MARGIN / DOTS, MARGIN / DOTS, 0.0]
    return _warped(paper, there)


def _warped(paper: Any, T: Array, over: int = 3) -> Any:
    height, width = paper.shape
    corners = np.array([[0, 0, 0], [width, 0, 0], [width, height, 0], [0, height, 0]]) / DOTS
    H, _ = cv2.findHomography(
        2.0 * corners[:, :2] * DOTS - 0.5, (pixels(corners, T) + 0.5) * over - 0.5
    )
    double = cv2.resize(paper, None, fx=2, fy=2, interpolation=cv2.INTER_NEAREST)
    large = cv2.warpPerspective(double, H, (over * SIZE[0], over * SIZE[1]), borderValue=90)
    return cv2.resize(large, SIZE, interpolation=cv2.INTER_AREA)
