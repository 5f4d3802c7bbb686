"""A direction of view for line drawings in space."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib.arrays import Array


@dataclass(frozen=True)
class Viewpoint:
    """A direction of view: azimuth and elevation of the viewer [deg], seen without perspective."""

    azimuth: float
    elevation: float

    @cached_property
    def axes(self) -> Array:
        """Right, up and towards the viewer, rows of shape (3, 3)."""
        a, e = np.radians([self.azimuth, self.elevation])
        right = [-np.sin(a), np.cos(a), 0.0]
        up = [-np.sin(e) * np.cos(a), -np.sin(e) * np.sin(a), np.cos(e)]
        near = [np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)]
        return np.array([right, up, near])

    def flat(self, points: Array) -> Array:
        """Points (..., 3) m as seen, (..., 2) m."""
        out: Array = np.asarray(points, dtype=float) @ self.axes[:2].T
        return out

    def order(self, points: Array) -> float:
        """Drawing order of what stands at these points: nearer is higher."""
        return 10.0 + float(np.mean(np.asarray(points, dtype=float) @ self.axes[2]))
