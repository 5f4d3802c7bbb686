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

LEAST_SQUARE, LEAST_MARKER = 10.0, 20.0
"""px, of a square of a chessboard and of an ArUco marker or AprilTag, across, as OpenCV finds them."""

_MOST, _MOST_TAGS = 10_000, 2500  # corners, tags
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
        from_middle = np.linalg.norm(self.points - self.points.mean(axis=0), axis=1)
        chosen = [int(from_middle.argmin())]
        away = np.full(len(self.points), np.inf)
        while len(chosen) < min(_BEAMS, len(self.points)):
            last = np.linalg.norm(self.points - self.points[chosen[-1]], axis=1)
            away = np.minimum(away, last)
            chosen.append(int(away.argmax()))
        nearest = np.argmin(
            np.linalg.norm(self.points[:, None] - self.points[chosen], axis=2), axis=1
        )
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
    """A board: its points one by one, or how they are arranged."""

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
    tags: tuple[Count, Count] | None = None
    """instead of squares: tags across and down; their corners are 3_0 .. 3_3"""
    tag_mm: Positive | None = None
    """edge of a tag"""
    gap_mm: Positive | None = None
    """gap between two tags"""
    first_tag: Annotated[int, Strict(), Field(ge=0, le=1_000_000)] = 0
    """number of the first tag"""
    dictionary: str | None = None
    """OpenCV's name of the markers or tags, such as DICT_5X5_100"""

    @model_validator(mode="after")
    def _one_shape(self) -> Self:
        shapes = [bool(self.points_mm), self.squares is not None, self.tags is not None]
        of_tags = {own is None for own in (self.tags, self.tag_mm, self.gap_mm)}
        charuco = (self.marker_mm is None, self.dictionary is None)
        if sum(shapes) != 1:
            fault = (
                "needs its shape: either points_mm, or squares and pitch_mm, or tags, tag_mm and "
            )
            raise ValueError(fault + "gap_mm")
        if (self.squares is None) != (self.pitch_mm is None):
            raise ValueError("squares and pitch_mm go together")
        if len(of_tags) > 1:
            raise ValueError("tags, tag_mm and gap_mm go together")
        if charuco[0] != charuco[1] and self.tags is None:
            fault = "marker_mm and dictionary go together: they make squares a ChArUco board"
            raise ValueError(fault)
        if self.marker_mm is not None and self.marker_mm >= (self.pitch_mm or 0.0):
            raise ValueError("marker_mm belongs to squares, and is smaller than pitch_mm")
        if self.tags is not None and math.prod(self.tags) > _MOST_TAGS:
            raise ValueError("tags are as many as the board has, [across, down], at most 2500")
        if self.squares is not None and not 4 <= math.prod(n - 1 for n in self.squares) <= _MOST:
            fault = "squares are as many as the board has, [across, down], with four corners"
            raise ValueError(fault)
        return self

    def shape(self) -> tuple[tuple[str, ...], Array]:
        """Names and points (n, 3), m, x to the right and y down as one looks at it.

        Of squares the inner corners, row by row; of tags the corners of each, from its upper left one
        in the direction of the clock, ``3_0`` the first one of tag 3; else the points as given.
        """
        if self.squares is not None:
            across, down = (n - 1 for n in self.squares)
            points = _grid(across, down, 1.0) * (self.pitch_mm or 0.0)
            return tuple(map(str, range(len(points)))), points * MM
        if self.tags is not None:
            side = self.tag_mm or 0.0
            at = _grid(*self.tags, 0.0) * (side + (self.gap_mm or 0.0))
            corners = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]) * side
            names = [f"{self.first_tag + k}_{c}" for k in range(len(at)) for c in range(4)]
            return tuple(names), (at[:, None] + corners).reshape(-1, 3) * MM
        return tuple(self.points_mm), np.array(list(self.points_mm.values())) * MM

    def board(self, name: str, channels: slice, points: Array, least: int | None) -> Board:
        """The board with the points that are read of it.

        least : points by which it counts, by default all of a chessboard. Where nobody said how it
            stands, nobody knows which way it faces
        """
        chessboard = self.squares is not None and self.marker_mm is None
        side = self.pitch_mm if chessboard else self.marker_mm or self.tag_mm
        square = LEAST_SQUARE if chessboard else LEAST_MARKER
        every = len(points) if chessboard and self.stated else 1
        least = every if least is None else min(least, len(points))
        return Board(name, channels, points, (side or 0.0) * MM, square, least, self.stated)


def _grid(across: int, down: int, first: float) -> Array:
    """Places (n, 3) of a grid of pitch one, row by row."""
    at = np.indices((down, across)).reshape(2, -1)[::-1].T + first
    return np.column_stack([at, np.zeros(len(at))])
