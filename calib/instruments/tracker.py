"""A laser tracker, or another instrument that measures points: three coordinates of each."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Discriminator, Tag

from calib.arm.se3 import moved_as_one, rotate, so3_exp
from calib.arrays import Array, Mask
from calib.instruments.keys_table import KeysTable
from calib.instruments.placing import placed
from calib.instruments.protocol import (
    FRAME,
    Instrument,
    Linear,
    Nominal,
    ReadingColumn,
    Start,
    Unknown,
)
from calib.instruments.riding import twist_of
from calib.keys import NotNegativeMetres, Point, Positive, PositiveMetres, TomlTable, Written, key
from calib.noise import Noise


@dataclass(frozen=True, eq=False, init=False)
class Tracker(Instrument):
    """Points in the frame of its station, turned and shifted against the base anyhow.

    The place is ``T_station_base`` = [exp(rx, ry, rz) | x, y, z]; at zero the frames coincide.
    ``Tracker(sigma=1e-5)`` is one with the same standard deviation [m] in every coordinate.

    noise : Noise, along and across the beam
    stands : ndarray, shape (3,), m, base frame, where the beams start; None for the origin of the
        readings
    """

    noise: Noise = field(default_factory=lambda: Noise.isotropic(1.0))
    stands: Array | None = None
    kind: ClassVar[str] = "points"
    rows: ClassVar[int] = 3
    unknowns: ClassVar[tuple[Unknown, ...]] = FRAME
    columns: ClassVar[tuple[ReadingColumn, ...]] = tuple(ReadingColumn(c, "length") for c in "xyz")
    stationed: ClassVar[bool] = True

    def __init__(
        self,
        sigma: float = 1.0,
        noise: Noise | None = None,
        stands: Array | None = None,
        **named: Any,
    ) -> None:
        """Make a tracker of its noise; the other fields are those of any instrument.

        sigma : m, of every coordinate at any range, where no ``noise`` is given
        """
        super().__init__(**named)
        object.__setattr__(self, "noise", noise or Noise.isotropic(sigma))
        object.__setattr__(self, "stands", stands)

    @staticmethod
    def placement(place: Array) -> tuple[Array, Array]:
        """R_station_base (..., 3, 3) and p_station_base (..., 3), m, of a place (..., 6)."""
        return so3_exp(place[..., 3:]), place[..., :3]

    def linearise(self, place: Array, points: Array) -> Linear:
        rows, R, by_place = moved_as_one(place[..., None, :], points)
        return Linear(rows, R if place.any() else None, by_place)

    def whitening(self, place: Array, rows: Array, sigma: Array) -> Array:
        return self.noise.whitening(self.beams(place, rows), sigma)

    def beams(self, place: Array, rows: Array) -> Array:
        """Vectors (..., m, C, 3), m, to the points of rows, in the axes of the station."""
        if self.stands is None:
            return rows
        R, p = self.placement(place)
        return rows - (rotate(R, self.stands) + p)[..., None, None, :]

    @property
    def even(self) -> float | None:
        return None if self.noise.grows else self.noise.along

    @property
    def fixed(self) -> bool:
        return self.stands is not None and self.noise.grows

    @property
    def position(self) -> Array | None:
        return self.stands

    def start(self, rows: Array, seen: Mask, arm: Nominal) -> Start:
        R, t, markers = placed(rows, seen, arm)
        told = arm.free & np.any(seen, axis=0)[:, None]
        return Start(twist_of(R, t), markers, told)


TRACKER = Tracker()
"""A tracker of unknown noise: its rows count in metres."""


class PolarSigma(TomlTable):
    """Standard deviations along and across the beam."""

    along: Annotated[PositiveMetres, key("range_mm")]
    """standard deviation along the beam"""
    across: Annotated[PositiveMetres, key("transverse_mm")]
    """standard deviation across the beam"""
    along_per_m: Annotated[NotNegativeMetres, key("range_mm_per_m")] = 0.0
    """growth of range_mm for each metre of range"""
    across_per_m: Annotated[NotNegativeMetres, key("transverse_mm_per_m")] = 0.0
    """growth of transverse_mm for each metre of range"""


class MpeSigma(TomlTable):
    """A maximum permissible error, and what makes a standard deviation of it."""

    mpe: Annotated[PositiveMetres, key("mpe_mm")]
    """maximum permissible error"""
    mpe_per_m: Annotated[NotNegativeMetres, key("mpe_mm_per_m")] = 0.0
    """growth of mpe_mm for each metre of range"""
    divisor: Positive
    """standard deviation = maximum permissible error / divisor"""


def _kind_of_sigma(value: Any) -> str:
    if not isinstance(value, dict):
        return "number"
    of_mpe = any(str(key).startswith("mpe") or key == "divisor" for key in value)
    return "mpe" if of_mpe else "polar"


Sigma = Annotated[
    Annotated[Noise, Written(PositiveMetres, Noise.isotropic), Tag("number")]
    | Annotated[Noise, Written(PolarSigma, lambda own: Noise(**dict(own))), Tag("polar")]
    | Annotated[
        Noise, Written(MpeSigma, lambda own: Noise.maximum_permissible(**dict(own))), Tag("mpe")
    ],
    Discriminator(_kind_of_sigma),
]


class TrackerTable(TomlTable):
    """``[instrument]``, the only one of a cell."""

    noise: Annotated[Sigma, key("sigma_mm")]
    """one standard deviation of one coordinate; or a table: by range, or from a maximum
    permissible error"""
    stands: Annotated[Point | None, key("position_mm")] = None
    """position in the base's frame, for range and line of sight; without it the range is from the
    origin of the readings"""

    def tracker(self) -> Tracker:
        """One that reads all markers."""
        return Tracker(**dict(self))


class PointsTable(TrackerTable, KeysTable):
    """A tracker among several instruments: its keys in a cell."""

    makes = Tracker
    kind: Literal["points"]
    """kind of instrument (posecal explain instruments)"""
