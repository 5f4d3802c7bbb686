"""What instruments read: markers, bodies, boards, and lengths known between points."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, Self

from pydantic import Discriminator, Field, Strict, Tag, model_validator

from calib.files.schema.values import Count, Direction, Name, Number, Positive, Table, Vector


class MarkerTable(Table):
    position: Vector
    normal: Direction | None = None
    acceptance_deg: Annotated[Number, Field(gt=0, le=180)] | None = None


def _kind_of_marker(value: Any) -> str:
    return "table" if isinstance(value, dict) else "position"


Marker = Annotated[
    Annotated[Vector, Tag("position")] | Annotated[MarkerTable, Tag("table")],
    Discriminator(_kind_of_marker),
]


class BodyTable(Table):
    position_mm: Vector = (0.0, 0.0, 0.0)
    rpy_deg: Vector = (0.0, 0.0, 0.0)


Anywhere = Annotated[float, Strict(), Field(allow_inf_nan=False)]
"""A coordinate that need not be plausible as long as nobody measures the point."""


class BoardTable(BodyTable):
    on: Literal["tip", "world"]
    points_mm: dict[Name, tuple[Anywhere, Anywhere, Anywhere]] = {}
    squares: tuple[Count, Count] | None = None
    pitch_mm: Positive | None = None
    marker_mm: Positive | None = None  # of the markers in its white squares
    tags: tuple[Count, Count] | None = None
    tag_mm: Positive | None = None
    gap_mm: Positive | None = None
    first_tag: Annotated[int, Strict(), Field(ge=0, le=1_000_000)] = 0
    dictionary: str | None = None  # of markers or tags, as OpenCV calls it

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


class KnownDistanceTable(Table):
    between: tuple[Name, Name]
    mm: Positive
    sigma_mm: Positive
