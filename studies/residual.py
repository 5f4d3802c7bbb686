"""What a reading is off by, as a result holds it: in space, along one length, or in an image."""

from __future__ import annotations

from typing import Self, TypeAlias

from pydantic import model_validator

from studies.record import Entry, Maybe, Number, Three

Lengths: TypeAlias = Three | tuple[Number]
"""Residual of a point, or of one length, mm."""
Pixels: TypeAlias = tuple[Number, Number]


class Off(Entry):
    """Measured minus predicted reading: x, y and z of a point, one length d, or u and v of an image."""

    pose: str
    marker: str
    instrument: str = "instrument"
    x_mm: Maybe = None
    y_mm: Maybe = None
    z_mm: Maybe = None
    d_mm: Maybe = None
    u_px: Maybe = None
    v_px: Maybe = None
    heldout: bool

    @model_validator(mode="after")
    def _one_place(self) -> Self:
        if len(self._told) != 1:
            raise ValueError("a residual has either x_mm, y_mm and z_mm, or d_mm, or u_px and v_px")
        if len(self.before) != len(self.vector):
            raise ValueError("a residual has not as many numbers before as after")
        return self

    @property
    def _told(self) -> list[tuple[float, ...]]:
        places = ((self.x_mm, self.y_mm, self.z_mm), (self.d_mm,), (self.u_px, self.v_px))
        found = (tuple(x for x in place if x is not None) for place in places)
        return [own for own, place in zip(found, places, strict=True) if len(own) == len(place)]

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
        return self.u_px is None
