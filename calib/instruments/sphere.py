"""A sphere that the marker touches, or a gauge that reads the distance to it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal, Self

import numpy as np
from pydantic import model_validator

from calib.arrays import Array, Mask
from calib.files.values import MM, Positive, Vector
from calib.instruments.even import POINT, Surface, around, best, contacts, mirrored
from calib.instruments.protocol import (
    CellParts,
    KeysTable,
    Linear,
    Nominal,
    ReadingColumn,
    Start,
    Unknown,
)


@dataclass(frozen=True, eq=False)
class Sphere(Surface):
    """``|p - c| - r``, read as zero or by a gauge; the place is c in base axes, and r if unknown.

    radius : float, m, None if unknown; plans then take the one that stands in ``standing``
    """

    radius: float | None = None
    kind: ClassVar[str] = "sphere"
    given_by: ClassVar[str] = "position_mm, and radius_mm or about_radius_mm,"
    rows: ClassVar[int] = 1
    columns: ClassVar[tuple[ReadingColumn, ...]] = (ReadingColumn("d", "length", optional=True),)

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        return POINT if self.radius is not None else (*POINT, Unknown("radius", "mm", 1e-3, 1e-2))

    @property
    def metric(self) -> bool:
        return self.radius is not None

    def linearise(self, place: Array, points: Array) -> Linear:
        away = points - place[..., None, None, :3]
        distance = np.linalg.norm(away, axis=-1, keepdims=True)
        along = (away / distance)[..., None, :]
        by_radius = [-np.ones((*distance.shape, 1))] if self.radius is None else []
        radius = place[..., 3:] if self.radius is None else np.full(1, self.radius)
        rows = distance - radius[..., None, None, :]
        return Linear(rows, along, np.concatenate([-along, *by_radius], axis=-1))

    def start(self, rows: Array, seen: Mask, arm: Nominal) -> Start:
        """``|p|^2 - d^2 = 2 p c + 2 d r - (|c|^2 - r^2)``, its mirror, and from all around."""
        _, _, p = contacts(seen, arm)
        d = rows[seen][:, 0]
        known = 0.0 if self.radius is None else 2.0 * d * self.radius
        A = np.column_stack([2.0 * p, -np.ones(len(p))])
        linear = np.linalg.lstsq(A, (p**2).sum(axis=1) - d**2 - known, rcond=1e-6)[0][:3]
        size = float(np.ptp(p, axis=0).max()) if self.radius is None else self.radius
        given = [] if self.standing is None else [self.guess[:3]]
        centres = np.array([*given, linear, mirrored(linear, p), *around(p, size)])
        if self.radius is None:
            away = np.linalg.norm(p - centres[:, None], axis=-1)
            centres = np.column_stack([centres, np.median(away - d, axis=-1)])
        return best(self, rows, seen, arm, centres)


class SphereTable(KeysTable):
    """A sphere: its keys in a cell."""

    rides = False
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

    def instrument(self, name: str, cell: CellParts) -> Sphere:
        standing = None
        if self.position_mm is not None and (self.radius_mm or self.about_radius_mm) is not None:
            about = () if self.radius_mm is not None else (self.about_radius_mm,)
            standing = np.array([[*self.position_mm, *about]]) * MM
        return Sphere(
            name=name,
            markers=cell.read_from(self.on),
            sigma=self.sigma_mm * MM,
            radius=None if self.radius_mm is None else self.radius_mm * MM,
            standing=standing,
        )
