"""Noise of the instrument, which may grow with range: what is true, and what the user believes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from studies.research.withheld.robots import Array

MIDDLE = 4.5  # m, from the instrument to the middle of the cell
_STEP = 1e-7  # m and m/m: standard deviations are rounded as the cell shows them


@dataclass(frozen=True)
class Noise:
    """Standard deviations along the beam, and in each direction across it, from the instrument.

    along, across : m; across_per_m : m/m, by which the latter grows with range
    """

    along: float
    across: float
    across_per_m: float = 0.0

    @classmethod
    def uniform(cls, sigma: float) -> Noise:
        """The same [m] in every direction at any range."""
        return cls(sigma, sigma)

    @property
    def grows(self) -> bool:
        """Whether range and direction matter."""
        return self.across_per_m > 0.0 or self.along != self.across

    @property
    def sigma(self) -> float:
        """Root mean square of one coordinate in the middle of the cell, m."""
        if not self.grows:
            return self.along
        across = self.across + self.across_per_m * MIDDLE
        return float(np.sqrt((self.along**2 + 2.0 * across**2) / 3.0))

    def times(self, factor: float) -> Noise:
        """The same law at another size."""
        return Noise(self.along * factor, self.across * factor, self.across_per_m * factor)

    def coloured(self, normal: Array, points: Array) -> Array:
        """Standard normal vectors (..., 3) with the covariance of each point (..., 3), m."""
        return self._scaled(normal, points, 1.0)

    def whitened(self, moved: Array, points: Array) -> Array:
        """Vectors (..., 3), m, at points (..., 3), m, in standard deviations."""
        return self._scaled(moved, points, -1.0)

    def rms(self, points: Array, seen: NDArray[np.bool_]) -> float:
        """3-D root mean square over the points seen, m: the floor that no model gets below."""
        if not self.grows:
            return float(np.sqrt(3.0)) * self.along
        across = self.across + self.across_per_m * np.linalg.norm(points[seen], axis=-1)
        return float(np.sqrt(self.along**2 + 2.0 * np.mean(across**2)))

    def _scaled(self, vectors: Array, points: Array, power: float) -> Array:
        away = np.linalg.norm(points, axis=-1, keepdims=True)
        beam = points / away
        along = beam * np.sum(beam * vectors, axis=-1, keepdims=True)
        across = np.power(self.across + self.across_per_m * away, power)
        scaled: Array = along * np.power(self.along, power) + (vectors - along) * across
        return scaled


def growing(rng: np.random.Generator, sigma: float) -> Noise:
    """A tracker's law: good distances, angles that cost the more the farther the point.

    sigma : m, typical; between two and eight metres the error across grows two- to threefold
    """
    drawn = sigma * rng.uniform((0.3, 0.2, 0.12), (0.8, 0.5, 0.24))
    return Noise(*(float(v) for v in np.round(drawn / _STEP) * _STEP))
