"""Bodies that stand still around the arm.

The capsules of the arm and of the tool must keep clear of them. Those of the base need not: they
never move, so nothing could be chosen to keep them clear.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from calib.arm.se3 import from_xyz_rpy
from calib.arrays import Array, Mask
from calib.cell import Cell
from doe.constraints.distances import (
    point_box,
    point_segment,
    segment_box,
    segment_halfspace,
)
from doe.constraints.protocol import Constraint
from doe.constraints.scene import Scene

_MM = 1e-3


@dataclass(frozen=True, eq=False)
class Obstacle(Constraint):
    """A body at rest in the base frame."""

    name: str

    @abstractmethod
    def from_segment(self, start: Array, end: Array) -> Array:
        """Distance of n segments (n, 3), shape (n,), m; zero where they meet."""

    def from_point(self, point: Array) -> Array:
        """Distance of n points (n, 3), shape (n,), m; zero inside."""
        return self.from_segment(point, point)

    @property
    def ball(self) -> tuple[Array, float] | None:
        """Centre (3,) and radius [m] of a ball that holds it; None for what has no end."""
        return None

    def allows(self, scene: Scene) -> Mask:
        free = np.ones(len(scene), dtype=bool)
        for capsule in scene.capsules:
            if capsule.moves:
                near = np.flatnonzero(free & (self.from_point(capsule.centre) <= capsule.reach))
                distance = self.from_segment(capsule.start[near], capsule.end[near])
                free[near] = distance > capsule.radius
        return free


@dataclass(frozen=True, eq=False)
class Box(Obstacle):
    """T_base_box : ndarray, shape (4, 4); half : ndarray, shape (3,), m, half its size."""

    T_base_box: Array
    half: Array

    def from_segment(self, start: Array, end: Array) -> Array:
        return segment_box(self._local(start), self._local(end), self.half)

    def from_point(self, point: Array) -> Array:
        return point_box(self._local(point), self.half)

    @property
    def ball(self) -> tuple[Array, float] | None:
        return self.T_base_box[:3, 3], float(np.linalg.norm(self.half))

    def _local(self, point: Array) -> Array:
        return np.asarray((point - self.T_base_box[:3, 3]) @ self.T_base_box[:3, :3])


@dataclass(frozen=True, eq=False)
class Sphere(Obstacle):
    """centre : ndarray, shape (3,), m; radius : float, m."""

    centre: Array
    radius: float

    def from_segment(self, start: Array, end: Array) -> Array:
        return np.maximum(point_segment(self.centre, start, end) - self.radius, 0.0)

    @property
    def ball(self) -> tuple[Array, float] | None:
        return self.centre, self.radius


@dataclass(frozen=True, eq=False)
class HalfSpace(Obstacle):
    """All that lies beyond the plane through a point (3,), m, on the side of its normal (3,)."""

    point: Array
    normal: Array

    def from_segment(self, start: Array, end: Array) -> Array:
        return segment_halfspace(start, end, self.point, self.normal)


def obstacles_of(cell: Cell) -> tuple[Obstacle, ...]:
    """The obstacles of a cell, each a constraint of its own."""
    tables = cell.design.get("obstacle", [])
    return tuple(_obstacle(i, table) for i, table in enumerate(tables, 1))


def _obstacle(number: int, table: Mapping[str, Any]) -> Obstacle:
    kind = table["type"]
    name = f"obstacle {number} ({kind})"
    if kind == "box":
        T = from_xyz_rpy(_metres(table["center_mm"]), np.radians(table["rpy_deg"]))
        return Box(name, T, 0.5 * _metres(table["size_mm"]))
    if kind == "sphere":
        return Sphere(name, _metres(table["center_mm"]), table["radius_mm"] * _MM)
    return HalfSpace(name, _metres(table["point_mm"]), np.array(table["normal"], dtype=float))


def _metres(vector: tuple[float, float, float]) -> Array:
    return np.array(vector, dtype=float) * _MM
