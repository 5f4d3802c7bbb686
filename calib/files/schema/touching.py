"""Instruments that touch or span: ``distance``, ``plane``, ``sphere`` and ``socket``."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Strict, model_validator

from calib.files.schema.values import Direction, NotNegative, Positive, Table, Vector, ordered


class DistanceTable(Table):
    kind: Literal["distance"]
    sigma_mm: Positive
    anchor_mm: Vector | None = None
    offset: Annotated[bool, Strict()] = False
    reach_mm: Annotated[tuple[NotNegative, NotNegative], AfterValidator(ordered)] | None = None

    @model_validator(mode="after")
    def _reach_from_somewhere(self) -> Self:
        if self.reach_mm is not None and self.anchor_mm is None:
            raise ValueError("has reach_mm, which counts from anchor_mm; add that")
        return self


class PlaneTable(Table):
    kind: Literal["plane"]
    sigma_mm: Positive
    position_mm: Vector | None = None
    normal: Direction | None = None

    @model_validator(mode="after")
    def _whole_plane(self) -> Self:
        if (self.position_mm is None) != (self.normal is None):
            raise ValueError("position_mm, a point of it, and normal go together")
        return self


class SphereTable(Table):
    kind: Literal["sphere"]
    sigma_mm: Positive
    radius_mm: Positive | None = None
    about_radius_mm: Positive | None = None
    position_mm: Vector | None = None

    @model_validator(mode="after")
    def _one_radius(self) -> Self:
        if self.radius_mm is not None and self.about_radius_mm is not None:
            raise ValueError(
                "radius_mm is a known radius, about_radius_mm one to be found; give one"
            )
        return self


class SocketTable(Table):
    kind: Literal["socket"]
    sigma_mm: Positive
    position_mm: Vector | None = None
