"""Unknown functions: a few coefficients, and how smooth they are expected to be.

A function of a variable v is a sum of basis functions; its coefficients are a priori normal with the
covariance ``exp(-distance / length)`` of an Ornstein-Uhlenbeck process, which takes a step as readily
as a slope. How large the function is, the data say (:mod:`calib.diagnosis.screen`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from calib.arrays import Array

_LENGTH = 0.5  # of a variable's range, over which a function forgets its value
_APART = 2.0  # standard deviations of posture, likewise
_MOST_CENTRES = 30
_SAME = 1e-9


class Function(ABC):
    """A function of a variable with K coefficients."""

    @property
    @abstractmethod
    def labels(self) -> tuple[str, ...]:
        """A name for each coefficient: where it acts."""

    @abstractmethod
    def at(self, values: Array) -> Array:
        """Basis functions, shape (..., K), at values of the variable; zero where it is not given."""

    @property
    @abstractmethod
    def spread(self) -> Array:
        """Covariance of the coefficients a priori, shape (K, K), of unit amplitude."""


@dataclass(frozen=True, eq=False)
class Polyline(Function):
    """Values at knots, linear between them and constant beyond.

    knots : ndarray, shape (K,), ascending
    """

    knots: Array

    @property
    def labels(self) -> tuple[str, ...]:
        return tuple(f"{knot:.4g}" for knot in self.knots)

    def at(self, values: Array) -> Array:
        knots, given = self.knots, np.isfinite(values)
        inside = np.clip(np.where(given, values, knots[0]), knots[0], knots[-1])
        upper = np.clip(np.searchsorted(knots, inside, side="left"), 1, len(knots) - 1)
        share = (inside - knots[upper - 1]) / (knots[upper] - knots[upper - 1])
        weights = np.zeros((*np.shape(values), len(knots)))
        np.put_along_axis(weights, (upper - 1)[..., None], (1.0 - share)[..., None], axis=-1)
        np.put_along_axis(weights, upper[..., None], share[..., None], axis=-1)
        return np.asarray(weights * given[..., None])

    @property
    def spread(self) -> Array:
        length = _LENGTH * (self.knots[-1] - self.knots[0])
        return np.asarray(np.exp(-np.abs(self.knots[:, None] - self.knots) / length))


@dataclass(frozen=True, eq=False)
class Neighbours(Function):
    """Values at centres; between them the expectation, far from all of them zero.

    centres : ndarray, shape (K, d)
    """

    centres: Array

    @property
    def labels(self) -> tuple[str, ...]:
        return tuple(str(i + 1) for i in range(len(self.centres)))

    def at(self, values: Array) -> Array:
        return np.asarray(np.linalg.solve(self.spread, self._alike(values).T).T)

    @property
    def spread(self) -> Array:
        return self._alike(self.centres)

    def _alike(self, values: Array) -> Array:
        apart = np.linalg.norm(values[:, None, :] - self.centres, axis=-1)
        return np.asarray(np.exp(-apart / _APART))


def polyline(values: Array, most: int) -> Polyline | None:
    """A function of what a variable takes in the data, None where it does not vary.

    values : ndarray, shape (m,); most : int, knots
    """
    distinct = np.unique(np.round(values / max(np.abs(values).max(initial=0.0), _SAME), 9))
    if len(distinct) < 2:
        return None
    return Polyline(np.linspace(values.min(), values.max(), min(most, len(distinct))))


def neighbours(values: Array) -> Neighbours:
    """A function around the values (m, d) that lie farthest from each other, one after the other."""
    distinct = np.unique(np.round(values, 6), axis=0)
    chosen = [0]
    away = np.linalg.norm(distinct - distinct[0], axis=-1)
    while len(chosen) < min(_MOST_CENTRES, len(distinct)):
        chosen.append(int(np.argmax(away)))
        away = np.minimum(away, np.linalg.norm(distinct - distinct[chosen[-1]], axis=-1))
    return Neighbours(distinct[np.sort(chosen)])
