"""``[design]``: how many poses are asked for, at which levels, between which obstacles."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Strict, Tag

from calib.files.schema.values import Count, Direction, NotNegative, Number, Positive, Table, Vector


class LevelsTable(Table):
    poses_per_level: Count
    count: Count | None = None
    min_separation_deg: NotNegative = 0.0
    values_deg: list[Number] | None = None


class Box(Table):
    type: Literal["box"]
    center_mm: Vector
    size_mm: tuple[Positive, Positive, Positive]
    rpy_deg: Vector = (0.0, 0.0, 0.0)


class Sphere(Table):
    type: Literal["sphere"]
    center_mm: Vector
    radius_mm: Positive


class HalfSpace(Table):
    type: Literal["halfspace"]
    point_mm: Vector
    normal: Direction


def _kind_of_floor(value: Any) -> str:
    return "none" if value is False else "number"


FloorHeight = Annotated[
    Annotated[Number, Tag("number")] | Annotated[Literal[False], Tag("none")],
    Discriminator(_kind_of_floor),
]


class DesignTable(Table):
    poses: Count | None = None
    levels: dict[str, LevelsTable] = {}
    targets: str | None = None
    targets_after_h: NotNegative | None = None
    repeats: Annotated[bool, Strict()] = False
    reference_every: Count | None = None
    reapproaches: Count | None = None
    floor_mm: FloorHeight | None = None
    obstacle: list[Annotated[Box | Sphere | HalfSpace, Field(discriminator="type")]] = []
