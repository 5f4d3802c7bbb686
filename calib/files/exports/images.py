"""Boards found in an image by OpenCV, as pixels of their points: chessboards, ChArUco, tags.

Corners are found finer than a pixel. A gradient at a corner of a chessboard is square to the way from
the corner, on all sides alike. At the corner of a tag blur moves it inwards; edges stay where they are,
and meet in the corner.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import map_coordinates

from calib.arrays import Array, IntArray
from calib.errors import InputError
from calib.files.cell_table import cell_table
from calib.files.values import MM, BoardTable


@dataclass(frozen=True, eq=False)
class Pattern:
    """What is printed on a board: its table in a cell, of squares or of tags with a dictionary.

    names : of the points, in the order of those in its frame, ndarray, shape (n, 3), m
    """

    name: str
    table: BoardTable
    names: tuple[str, ...]
    points: Array


def pattern_of(cell_path: Path, name: str) -> Pattern:
    """The pattern of a board of a cell file. Raises InputError for a board that is none."""
    table = cell_table(cell_path)
    if name not in table.boards:
        known = f"boards are {', '.join(table.boards)}" if table.boards else "it has no [boards]"
        raise InputError("--board", "", f"{name!r} is not in {cell_path}", known)
    board = table.boards[name]
    what = remedy = ""
    if board.tags is not None and board.dictionary is None:
        what, remedy = "has tags and no dictionary", "name it, as apriltag_36h11"
    elif board.tags is None and board.squares is None:
        what = "has points_mm alone, which no picture shows"
        remedy = "give squares and pitch_mm, or tags, tag_mm and gap_mm"
    elif board.squares is not None and board.dictionary is None and sum(board.squares) % 2 == 0:
        across, down = board.squares
        what = f"of {across} x {down} squares looks the same turned by 180 deg"
        remedy = "use an even and an odd number, or ChArUco (dictionary, marker_mm)"
    if what:
        raise InputError(cell_path, f"boards.{name}", what, remedy)
    return Pattern(name, board, *board.shape())


_BLUR = 1.0  # px: sharp edges are stairs, between which gradients point anywhere
_WIDEST, _NARROWEST = 12, 2  # px from the corner
_ALONG = np.linspace(0.15, 0.85, 40)  # of an edge, where it is looked for: the rest is round
_STEP = 0.25  # px across an edge
_ROUNDS = 2


def smooth(cv2: Any, image: Any) -> Any:
    """The image as corners are looked for in it."""
    return cv2.GaussianBlur(image, (0, 0), _BLUR)


def saddles(cv2: Any, image: Any, corners: Array, room: Array) -> Array:
    """Corners of a chessboard (n, 2), px, near those given; room : (n,), px, that is free around."""
    found = corners.copy()
    widths = np.clip(room.astype(int), _NARROWEST, _WIDEST)
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-4)
    for width in np.unique(widths).tolist():
        own = widths == width
        start = np.ascontiguousarray(corners[own].reshape(-1, 1, 2), dtype=np.float32)
        fine = cv2.cornerSubPix(image, start, (width, width), (-1, -1), stop)
        found[own] = np.asarray(fine, dtype=float).reshape(-1, 2)
    return found


def tag_corners(image: Any, corners: Array, cells: int) -> Array:
    """Corners (n, 4, 2), px, of dark tags near those given; cells : across a tag with its border."""
    pixels = np.asarray(image, dtype=float)
    for _ in range(_ROUNDS):
        corners = np.stack([_by_edges(pixels, own, cells) for own in corners])
    return corners


def _by_edges(pixels: Array, corners: Array, cells: int) -> Array:
    """Where the lines through the edges meet; the corner as given where an edge does not show."""
    after = np.roll(corners, -1, axis=0)
    lines = [_line(pixels, a, b, cells) for a, b in zip(corners, after, strict=True)]
    found = corners.copy()
    for k in range(4):
        (n1, d1), (n2, d2) = lines[k - 1], lines[k]
        N = np.array([n1, n2])
        if abs(np.linalg.det(N)) > 0.1:
            found[k] = np.linalg.solve(N, [d1, d2])
    return found


def _line(pixels: Array, a: Array, b: Array, cells: int) -> tuple[Array, float]:
    """The line ``n p = d`` along the edge from a to b, where it becomes light to its left."""
    side = float(np.linalg.norm(b - a))
    along = (b - a) / side
    normal = np.array([along[1], -along[0]])
    reach = np.clip(0.4 * side / cells, 1.5, 6.0)
    across = np.arange(-reach, reach + _STEP, _STEP)
    middle = a + np.outer(_ALONG, b - a)
    at = middle[:, None] + across[:, None] * normal
    sampled = map_coordinates(pixels, np.moveaxis(at, -1, 0)[::-1], order=1, mode="nearest")
    slope = np.maximum(np.diff(sampled, axis=1), 0.0)
    weight = slope.sum(axis=1)
    plain = weight > 0.5 * np.median(weight)
    if not weight.any() or plain.sum() < 5:
        return normal, float(normal @ a)
    off = (slope[plain] @ (across[:-1] + _STEP / 2.0)) / weight[plain]
    points = middle[plain] + off[:, None] * normal
    centre = points.mean(axis=0)
    _, _, axes = np.linalg.svd(points - centre)
    return axes[1], float(axes[1] @ centre)


FEWEST = 4  # points: fewer tell nothing of a board
_BESIDE = 0.85  # of the way to a marker in a white square
_BETWEEN = 0.4  # of the way to the next corner


def opencv(option: str) -> Any:
    """OpenCV. Raises InputError, where it is not installed, naming the option that needs it."""
    try:
        import cv2
    except ImportError:
        raise InputError(
            option, "", "needs OpenCV, which is not installed", "pip install 'posecal[images]'"
        ) from None
    return cv2


class Detector:
    """A pattern with OpenCV's detector for it."""

    def __init__(self, cv2: Any, pattern: Pattern) -> None:
        self.cv2, self.pattern, self.table = cv2, pattern, pattern.table
        self.charuco: list[Any] = []
        if self.table.dictionary is None:
            return
        words = _dictionary(cv2, pattern.name, self.table.dictionary)
        self.cells = int(words.markerSize) + 2
        if self.table.tags is not None:
            self.detector = cv2.aruco.ArucoDetector(words)
            return
        lengths = (self.table.pitch_mm or 0.0) * MM, (self.table.marker_mm or 0.0) * MM
        # Boards of before 4.6 begin with a white square if rows are even.
        for older in (False, True):
            board = cv2.aruco.CharucoBoard(self.table.squares, *lengths, words)
            board.setLegacyPattern(older)
            self.charuco.append(cv2.aruco.CharucoDetector(board))

    def found(self, image: Any) -> tuple[IntArray, Array]:
        """Numbers (n,) of the points seen, and where, (n, 2), px."""
        if self.table.tags is not None:
            ids, at = self._tags(image, math.prod(self.table.tags))
        elif self.charuco:
            ids, at = self._charuco(image)
        else:
            ids, at = self._chessboard(image)
        if len(ids) < FEWEST:
            return ids, at
        if self.table.tags is None:
            at = saddles(self.cv2, smooth(self.cv2, image), at, self._free(ids, at))
        height, width = image.shape
        inside = ((at >= 0.0) & (at <= [width - 1.0, height - 1.0])).all(axis=1)
        return ids[inside], at[inside]

    def _tags(self, image: Any, count: int) -> tuple[IntArray, Array]:
        corners, ids, _ = self.detector.detectMarkers(image)
        numbers = np.zeros(0, int) if ids is None else ids.ravel() - self.table.first_tag
        own = [k for k, n in enumerate(numbers) if 0 <= n < count and (numbers == n).sum() == 1]
        if not own:
            return np.zeros(0, dtype=int), np.zeros((0, 2))
        at = np.array([np.asarray(corners[k], float).reshape(4, 2) for k in own])
        at = tag_corners(smooth(self.cv2, image), at, self.cells)
        return (4 * numbers[own][:, None] + np.arange(4)).ravel(), at.reshape(-1, 2)

    def _charuco(self, image: Any) -> tuple[IntArray, Array]:
        """Of the two ways in which such boards are drawn the one that shows more, from then on."""
        found = []
        for detector in self.charuco:
            at, ids, *_ = detector.detectBoard(image)
            none = ids is None or not len(ids)
            found.append((np.zeros(0, int), np.zeros((0, 2))) if none else (ids.ravel(), at))
        best = int(np.argmax([len(ids) for ids, _ in found]))
        ids, at = found[best]
        if len(ids) >= FEWEST:
            self.charuco = [self.charuco[best]]
        return np.asarray(ids, dtype=int), np.asarray(at, dtype=float).reshape(-1, 2)

    def _chessboard(self, image: Any) -> tuple[IntArray, Array]:
        """The first square is dark, rows go down to the left of the columns that go right."""
        across, down = (n - 1 for n in self.table.squares or (1, 1))
        flags = self.cv2.CALIB_CB_EXHAUSTIVE | self.cv2.CALIB_CB_NORMALIZE_IMAGE
        done, at = self.cv2.findChessboardCornersSB(image, (across, down), flags=flags)
        if not done:
            return np.zeros(0, dtype=int), np.zeros((0, 2))
        grid = np.asarray(at, dtype=float).reshape(down, across, 2)
        right, below = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
        if right[0] * below[1] - right[1] * below[0] < 0.0:
            grid = grid[::-1]
        if _lightness(image, grid) > 0.0:
            grid = grid[::-1, ::-1]
        return np.arange(across * down), grid.reshape(-1, 2)

    def _free(self, ids: IntArray, at: Array) -> Array:
        """Pixels (n,) around each corner in which nothing else is printed."""
        shape, pitch = self.pattern.points[ids, :2], (self.table.pitch_mm or 0.0) * MM
        H, _ = self.cv2.findHomography(shape, at, 0)
        if H is None:  # points on one line
            return np.zeros(len(ids))
        margin = _BETWEEN * pitch
        if self.table.marker_mm is not None:
            margin = _BESIDE * (pitch - self.table.marker_mm * MM) / 2.0
        around = np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]]) * margin
        near = np.c_[(shape[:, None] + around).reshape(-1, 2), np.ones(4 * len(shape))] @ H.T
        middle = np.c_[shape, np.ones(len(shape))] @ H.T
        there = (near[:, :2] / near[:, 2:]).reshape(-1, 4, 2)
        return np.asarray(
            np.abs(there - (middle[:, :2] / middle[:, 2:])[:, None]).max(axis=2).min(axis=1)
        )


def _dictionary(cv2: Any, board: str, given: str) -> Any:
    """OpenCV's by its name, with or without ``DICT_``, in capitals or not. Raises InputError."""
    known = {n.upper().removeprefix("DICT_"): n for n in dir(cv2.aruco) if n.startswith("DICT_")}
    name = given.upper().removeprefix("DICT_")
    if name not in known:
        what = f"OpenCV has no dictionary {given[:40]!r}"
        remedy = "as 4x4_50, 5x5_100, 6x6_250, apriltag_36h11"
        raise InputError("--board", f"boards.{board}.dictionary", what, remedy)
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, known[name]))


def _lightness(image: Any, grid: Array) -> float:
    """Mean of the squares that should be light less that of those that should be dark, if turned."""
    middle = (grid[1:, 1:] + grid[1:, :-1] + grid[:-1, 1:] + grid[:-1, :-1]) / 4.0
    i, j = np.indices(middle.shape[:2])
    at = np.rint(middle).astype(int)
    values = np.asarray(image, dtype=float)[at[..., 1], at[..., 0]]
    dark = (i + j) % 2 == 0
    return float(values[dark].mean() - values[~dark].mean())
