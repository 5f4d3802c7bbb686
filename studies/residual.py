"""What a reading is off by, as a result holds it: in space, along a length, in an image, of angles."""

from __future__ import annotations

from typing import Self, TypeAlias

from pydantic import model_validator

from studies.record import Entry, Maybe, Number, Three

Lengths: TypeAlias = Three | tuple[Number]
"""Residual of a point, or of one length, mm."""
Pixels: TypeAlias = tuple[Number, Number]
Angles: TypeAlias = tuple[Number, Number]

_PLACES = (
    ("x_mm", "y_mm", "z_mm"),
    ("d_mm",),
    ("u_px", "v_px"),
    ("azimuth_mrad", "elevation_mrad"),
)
"""What an error may be told in."""


class Off(Entry):
    """Measured minus predicted reading: of a point, along one length, in an image, or of two angles."""

    pose: str
    marker: str
    instrument: str = "instrument"
    x_mm: Maybe = None
    y_mm: Maybe = None
    z_mm: Maybe = None
    d_mm: Maybe = None
    u_px: Maybe = None
    v_px: Maybe = None
    azimuth_mrad: Maybe = None
    elevation_mrad: Maybe = None
    heldout: bool

    @model_validator(mode="after")
    def _one_place(self) -> Self:
        if len(self._told) != 1:
            names = " or ".join(", ".join(place) for place in _PLACES)
            raise ValueError(f"a residual has either {names}")
        if len(self.before) != len(self.vector):
            raise ValueError("a residual has not as many numbers before as after")
        return self

    @property
    def _told(self) -> list[tuple[float, ...]]:
        found = (tuple(getattr(self, name) for name in place) for place in _PLACES)
        told = (tuple(x for x in place if x is not None) for place in found)
        return [own for own, place in zip(told, _PLACES, strict=True) if len(own) == len(place)]

    @property
    def vector(self) -> tuple[float, ...]:
        """Its numbers: three coordinates, one length, or two of the image."""
        return self._told[0]

    @property
    def before(self) -> tuple[float, ...]:
        """The same by the model that it is held against."""
        raise NotImplementedError

    @property
    def metric(self) -> bool:
        """Whether it is a length."""
        return self.x_mm is not None or self.d_mm is not None
