"""A board: its table in a cell, which of its points an image shows, and how well.

How well a point is seen was measured on drawn photographs: it depends on how large a square, or a
marker, is in the direction in which it is foreshortened.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Self

import numpy as np
from pydantic import Field, Strict, model_validator

from calib.arrays import Array, IntArray, Mask
from calib.instruments.keys_table import BodyTable
from calib.keys import MM, Count, Name, Positive

_LEAST_SQUARE, _LEAST_MARKER = 10.0, 20.0  # px across, of what OpenCV finds
_MOST = 10_000  # corners
_BEAMS = 5  # lines of sight to a board
_THIN = 1e-6  # of a square: points that are nearly on one line show no side


@dataclass(frozen=True, eq=False)
class Board:
    """A shape that is known.

    channels : slice, positions among the readings; points : ndarray, shape (n, 3), m, in its frame; of
        what is printed the z axis goes into the paper
    printed : float, m, side of its smallest figure; 0 for single points, which are seen from all sides
    square : float, px, that figure as small as OpenCV finds it; least : int, fewest points that count
    faced : whether it is known which way the print faces
    """

    name: str
    channels: slice
    points: Array
    printed: float = 0.0
    square: float = 0.0
    least: int = 1
    faced: bool = True

    def parts(self) -> Iterator[tuple[IntArray, int]]:
        """Points that lie together, by position, and the one among them that stands for them.

        Few enough to ask what hides them: the middle one, and each the farthest from those before.
        """
        away = np.linalg.norm(self.points[:, None] - self.points, axis=2)
        chosen = [int(np.linalg.norm(self.points - self.points.mean(axis=0), axis=1).argmin())]
        while len(chosen) < min(_BEAMS, len(self.points)):
            chosen.append(int(away[:, chosen].min(axis=1).argmax()))
        nearest = away[:, chosen].argmin(axis=1)
        for k, one in enumerate(chosen):
            yield np.flatnonzero(nearest == k), one

    def axes(self, viewed: Array) -> Array:
        """The x and y axes (..., 2, 3) of what is printed, in the axes of its points as viewed."""
        own = self.points - self.points.mean(axis=0)
        return np.asarray(
            np.linalg.pinv(own[:, :2]) @ (viewed - viewed.mean(axis=-2, keepdims=True))
        )

    def found(self, viewed: Array, seen: Mask, tilt: float) -> Mask:
        """Which of its points (..., n) count: in the image, enough of them, and facing the camera.

        viewed : ndarray, shape (..., n, 3), m, camera axes; seen : ndarray of bool, shape (..., n), in
            the image; tilt : rad, largest angle between the line of sight to a point and the normal
        """
        if self.printed and self.faced:
            x, y = np.moveaxis(self.axes(viewed), -2, 0)
            normal = np.cross(x, y)
            normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-300)
            away = np.maximum(np.linalg.norm(viewed, axis=-1), 1e-9)
            seen = seen & ((viewed * normal[..., None, :]).sum(axis=-1) / away >= np.cos(tilt))
        return np.asarray(seen & self.enough(seen)[..., None])

    def noise(self, rows: Array) -> Array:
        """By how much noise exceeds that of a large figure, (...), of pixels (..., n, 2) in an image.

        ``sqrt(1 + (2 s_0 / s)^2)``, of the figure's side s, px, across where it is foreshortened most,
        and s_0, as small as a detector finds it. Points that are not read are zero.
        """
        one = np.ones(rows.shape[:-2])
        if not self.printed:
            return one
        read = (rows != 0.0).any(axis=-1)[..., None]
        count = np.maximum(read.sum(axis=-2, keepdims=True), 1)
        own = read * (
            self.points[:, :2] - (read * self.points[:, :2]).sum(-2, keepdims=True) / count
        )
        pixels = rows - rows.sum(axis=-2, keepdims=True) / count
        spread = np.swapaxes(own, -1, -2) @ own
        known = np.linalg.det(spread) > _THIN * np.trace(spread, axis1=-2, axis2=-1) ** 2
        spread[~known] = np.eye(2)
        slopes = np.linalg.solve(spread, np.swapaxes(own, -1, -2) @ pixels)
        side = self.printed * np.linalg.svd(slopes, compute_uv=False)[..., -1]
        grown = np.hypot(one, 2.0 * self.square / np.maximum(side, self.square / 2.0))
        return np.where(known, grown, one)

    def enough(self, seen: Mask) -> Mask:
        """Whether so many of its points are seen (..., n) that they count, (...)."""
        return np.asarray(seen.sum(axis=-1) >= self.least)


Anywhere = Annotated[float, Strict(), Field(allow_inf_nan=False)]
"""A coordinate that need not be plausible as long as nobody measures the point."""


class BoardTable(BodyTable):
    """A board: its points one by one, or the squares of a chessboard."""

    on: Name
    """where it is fixed: world, tip, or a link of the robot"""
    points_mm: dict[Name, tuple[Anywhere, Anywhere, Anywhere]] = {}
    """points by name, in the board's frame"""
    squares: tuple[Count, Count] | None = None
    """squares of a chessboard, across and down; its points are the inner corners, row by row"""
    pitch_mm: Positive | None = None
    """edge of a square"""
    marker_mm: Positive | None = None
    """edge of the markers in the white squares, for a ChArUco board"""

    @model_validator(mode="after")
    def _one_shape(self) -> Self:
        if bool(self.points_mm) == (self.squares is not None):
            raise ValueError("needs its shape: either points_mm, or squares and pitch_mm")
        if (self.squares is None) != (self.pitch_mm is None):
            raise ValueError("squares and pitch_mm go together")
        if self.marker_mm is not None and self.marker_mm >= (self.pitch_mm or 0.0):
            raise ValueError("marker_mm belongs to squares, and is smaller than pitch_mm")
        if self.squares is not None and not 4 <= math.prod(n - 1 for n in self.squares) <= _MOST:
            fault = "squares are as many as the board has, [across, down], with four corners"
            raise ValueError(fault)
        return self

    def shape(self) -> tuple[tuple[str, ...], Array]:
        """Names and points (n, 3), m, x to the right and y down as one looks at it.

        Of squares the inner corners, row by row, by OpenCV's numbers; else the points as given.
        """
        if self.squares is None or self.pitch_mm is None:
            return tuple(self.points_mm), np.array(list(self.points_mm.values())) * MM
        across, down = (n - 1 for n in self.squares)
        at = np.indices((down, across)).reshape(2, -1)[::-1].T + 1.0
        points = np.column_stack([at, np.zeros(len(at))]) * self.pitch_mm * MM
        return tuple(map(str, range(len(points)))), points

    def board(self, name: str, channels: slice, points: Array, least: int | None) -> Board:
        """The board with the points that are read of it.

        least : points by which it counts, by default all of a chessboard, and half of a coded one: no
            camera finds its markers from near by. Where nobody said how it stands, nobody knows which
            way it faces
        """
        chessboard = self.squares is not None and self.marker_mm is None
        side = ((self.pitch_mm if chessboard else self.marker_mm) or 0.0) * MM
        square = _LEAST_SQUARE if chessboard else _LEAST_MARKER
        usual = len(points) if chessboard else -(-len(points) // 2)
        usual = usual if self.stated else 1
        least = usual if least is None else min(least, len(points))
        return Board(name, channels, points, side, square, least, self.stated)
