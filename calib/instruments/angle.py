"""A theodolite, or another instrument that reads two angles of a marker; its position is found."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from calib.arm.se3 import cross, moved_as_one, rotate, so3_log
from calib.arrays import Array, Mask
from calib.files.values import URAD, Positive
from calib.instruments.points import Tracker
from calib.instruments.protocol import (
    CellParts,
    Instrument,
    KeysTable,
    Linear,
    Nominal,
    Number,
    ReadingColumn,
    Start,
    Unknown,
)
from calib.instruments.resection import Mounted, on_tip, resected

_ACROSS = 0.2  # of a unit: below, a direction lies too near to that of a search's axis


@dataclass(frozen=True, eq=False)
class Angle(Instrument):
    """``atan2(y, x)`` and ``atan2(z, |x, y|)`` of a marker in its axes; the place is ``T_own_base``.

    sigma : float, rad, of either angle
    """

    sigma: float = 1.0
    kind: ClassVar[str] = "angle"
    rows: ClassVar[int] = 2
    unknowns: ClassVar[tuple[Unknown, ...]] = Tracker.unknowns
    columns: ClassVar[tuple[ReadingColumn, ...]] = (
        ReadingColumn("azimuth", "angle"),
        ReadingColumn("elevation", "angle"),
    )

    @property
    def metric(self) -> bool:
        return False

    @property
    def numbers(self) -> tuple[Number, ...]:
        return tuple(Number(column.name, "mrad", 1e-3) for column in self.columns)

    @property
    def unforeseen(self) -> str:
        return (
            "where it stands is found from readings alone; measure, and ask identify and diagnose"
        )

    def linearise(self, place: Array, points: Array) -> Linear:
        own, R, by_place = moved_as_one(place[..., None, :], points)
        x, y, z = np.moveaxis(own, -1, 0)
        level, none = np.hypot(x, y), np.zeros_like(x)
        away = level**2 + z**2
        by_own = np.stack(
            [
                np.stack([-y / level**2, x / level**2, none], axis=-1),
                np.stack([-x * z / level / away, -y * z / level / away, level / away], axis=-1),
            ],
            axis=-2,
        )
        rows = np.stack([np.arctan2(y, x), np.arctan2(z, level)], axis=-1)
        return Linear(rows, by_own @ R, by_own @ by_place)

    def difference(self, measured: Array, predicted: Array) -> Array:
        """Once around is nothing."""
        return np.asarray((measured - predicted + np.pi) % (2.0 * np.pi) - np.pi)

    def whitening(self, place: Array, rows: Array, sigma: Array) -> Array:
        """Of the circle and of the height alike; sigma : of an angle, rad."""
        del place
        own = np.where(np.isnan(sigma), self.sigma, sigma)[..., None, None]
        return np.broadcast_to(np.eye(2) / own, (*rows.shape, 2))

    def start(self, rows: Array, seen: Mask, arm: Nominal) -> Start:
        """As of a camera whose axis is the mean of all directions."""
        azimuth, elevation = rows[..., 0], rows[..., 1]
        level = np.cos(elevation)
        rays = np.stack(
            [level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=-1
        )
        ahead = rays[seen].mean(axis=0)
        ahead = ahead / np.linalg.norm(ahead)
        x = cross(np.eye(3)[int(np.abs(ahead).argmin())], ahead)
        x = x / np.linalg.norm(x)
        Q = np.stack([x, cross(ahead, x), ahead])  # of the camera in the instrument, by rows
        own = rotate(Q, rays)
        near = seen & (own[..., 2] > _ACROSS)
        ideal = own[..., :2] / np.where(near, own[..., 2], 1.0)[..., None]
        tips, nowhere = (arm.R_tip, arm.p_tip), (np.eye(3), np.zeros(3))
        found = resected(ideal, near, Mounted(tips, on_tip(arm, ()), nowhere, arm.placed))
        markers = np.stack([t for _, t in found.bodies])
        R, t = found.R, found.t
        told = arm.free & np.any(seen, axis=0)[:, None]
        return Start(np.concatenate([Q.T @ t, so3_log(Q.T @ R)]), markers, told)


class AngleTable(KeysTable):
    """A theodolite: its keys in a cell."""

    kind: Literal["angle"]
    sigma_urad: Positive

    def instrument(self, name: str, cell: CellParts) -> Angle:
        return Angle(name=name, markers=cell.read_from(self.on), sigma=self.sigma_urad * URAD)
