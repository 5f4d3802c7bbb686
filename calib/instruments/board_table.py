"""What a cell says of things that ride on a link or stand in the world: frames and boards."""

from __future__ import annotations

import math
from typing import Annotated, Self

import numpy as np
from pydantic import Field, Strict, model_validator

from calib.arm.se3 import from_xyz_rpy
from calib.arrays import Array
from calib.keys import MM, Count, Name, Positive, TomlTable, Vector


class RidingTable(TomlTable):
    """The table of something that may ride on a link of the robot."""

    on: Name = "tip"
    """link on which it rides, where that is not the tip"""


class BodyTable(RidingTable):
    """A frame."""

    position_mm: Vector = (0.0, 0.0, 0.0)
    """rough position in the frame of its link, or the world"""
    rpy_deg: Vector = (0.0, 0.0, 0.0)
    """rough orientation: roll, pitch, yaw"""

    @property
    def frame(self) -> Array:
        """Where it stands, shape (4, 4), m."""
        return from_xyz_rpy(np.array(self.position_mm) * MM, np.radians(self.rpy_deg))

    @property
    def stated(self) -> bool:
        """Whether the cell says where it stands."""
        return {"position_mm", "rpy_deg"} <= self.model_fields_set


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
        if sum(shapes) != 1:
            raise ValueError(
                "needs its shape: either points_mm, or squares and pitch_mm, or tags, tag_mm and gap_mm"
            )
        if (self.squares is None) != (self.pitch_mm is None):
            raise ValueError("squares and pitch_mm go together")
        if not (self.tags is None) == (self.tag_mm is None) == (self.gap_mm is None):
            raise ValueError("tags, tag_mm and gap_mm go together")
        if (self.marker_mm is None) != (self.dictionary is None) and self.tags is None:
            raise ValueError(
                "marker_mm and dictionary go together: they make squares a ChArUco board"
            )
        if self.marker_mm is not None and self.marker_mm >= (self.pitch_mm or 0.0):
            raise ValueError("marker_mm belongs to squares, and is smaller than pitch_mm")
        if self.tags is not None and math.prod(self.tags) > 2500:
            raise ValueError("tags are as many as the board has, [across, down], at most 2500")
        if self.squares is not None and not 4 <= math.prod(n - 1 for n in self.squares) <= 10_000:
            raise ValueError(
                "squares are as many as the board has, [across, down], with four corners"
            )
        return self

    def shape(self) -> tuple[tuple[str, ...], Array]:
        """Names and points (n, 3), m, x to the right and y down as one looks at it.

        Of squares the inner corners, row by row; of tags the corners of each, from its upper left one
        in the direction of the clock, ``3_0`` the first one of tag 3; else the points as given.
        """
        if self.squares is not None:
            across, down = (n - 1 for n in self.squares)
            grid = [(x + 1, y + 1, 0) for y in range(down) for x in range(across)]
            points = np.array(grid, dtype=float) * (self.pitch_mm or 0.0)
            return tuple(map(str, range(len(points)))), points * MM
        if self.tags is not None:
            across, down = self.tags
            side, pitch = self.tag_mm or 0.0, (self.tag_mm or 0.0) + (self.gap_mm or 0.0)
            corners = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]) * side
            at = np.array([(x, y, 0) for y in range(down) for x in range(across)]) * pitch
            names = [f"{self.first_tag + k}_{c}" for k in range(across * down) for c in range(4)]
            return tuple(names), (at[:, None] + corners).reshape(-1, 3) * MM
        return tuple(self.points_mm), np.array(list(self.points_mm.values())) * MM
