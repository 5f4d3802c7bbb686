"""Instruments of the tests' own: a distance from an anchor that stands anywhere, and a level."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from calib.arm.se3 import rotate
from calib.arrays import Array, Mask
from calib.instruments.protocol import Instrument, Linear, Nominal, ReadingColumn, Start, Unknown


@dataclass(frozen=True, eq=False)
class Ballbar(Instrument):
    """``|p - anchor|``; the anchor is unknown, in base axes. sigma : float, m."""

    sigma: float = 1e-5
    kind: ClassVar[str] = "distance"
    rows: ClassVar[int] = 1
    unknowns: ClassVar[tuple[Unknown, ...]] = tuple(Unknown(c, "mm", 1e-3, 1e-2) for c in "xyz")
    columns: ClassVar[tuple[ReadingColumn, ...]] = (ReadingColumn("d", "length"),)

    def read(self, place: Array, points: Array) -> Array:
        return np.linalg.norm(points - place[..., None, None, :], axis=-1, keepdims=True)

    def linearise(self, place: Array, points: Array) -> Linear:
        distance = self.read(place, points)
        along = ((points - place[..., None, None, :]) / distance)[..., None, :]
        return Linear(distance, along, -along)

    def whitening(self, place: Array, rows: Array, sigma: Array) -> Array:
        own = np.where(np.isnan(sigma), self.sigma, sigma)
        return np.asarray(1.0 / own[..., None, None])

    def start(self, rows: Array, seen: Mask, arm: Nominal) -> Start:
        """``|p|^2 - d^2 = 2 p . c - |c|^2`` is linear in c and its square."""
        points = rotate(arm.R_tip[:, None], arm.markers) + arm.p_tip[:, None]
        p, d = points[seen], rows[seen, 0]
        A = np.column_stack([2.0 * p, -np.ones(len(p))])
        solution = np.linalg.lstsq(A, (p**2).sum(axis=1) - d**2, rcond=None)[0]
        return Start(solution[:3], arm.markers, np.zeros_like(arm.free))


@dataclass(frozen=True, eq=False)
class Level(Ballbar):
    """Slope of the line from one marker to another, one if upright; nothing of it is unknown."""

    kind: ClassVar[str] = "level"
    each: ClassVar[int] = 2
    unknowns: ClassVar[tuple[Unknown, ...]] = ()

    def read(self, place: Array, points: Array) -> Array:
        line = points[..., 3:] - points[..., :3]
        return line[..., 2:] / np.linalg.norm(line, axis=-1, keepdims=True)

    def linearise(self, place: Array, points: Array) -> Linear:
        slope, length = self.read(place, points), points[..., 3:] - points[..., :3]
        size = np.linalg.norm(length, axis=-1, keepdims=True)
        by_end = ([0.0, 0.0, 1.0] - slope * length / size) / size
        by_points = np.concatenate([-by_end, by_end], axis=-1)[..., None, :]
        return Linear(slope, by_points, np.zeros((*slope.shape, 0)))

    def start(self, rows: Array, seen: Mask, arm: Nominal) -> Start:
        return Start(np.zeros(0), arm.markers, np.zeros_like(arm.free))
