"""What a criterion is: an information function that is set up for a robot.

Why an information function is enough for a certificate is said in :mod:`doe.optimal.function`. A new
criterion is one file with one such class and one entry in ``doe.criteria.CRITERIA``.

Matrices are in the coordinates y of ``theta = T y``, in which the mean information of the pool is the
identity; a criterion that speaks of the parameters themselves carries T.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Self

import numpy as np

from calib.arrays import Array, IntArray
from calib.errors import CalibError
from calib.model import Model
from doe.optimal.function import Conic, InformationFunction


def solved(M: Array, right: Array) -> Array:
    """``M^-1 right`` of matrices (..., p, p) and one (p, k) for all: NumPy before 2 wants it spread."""
    if M.ndim > 2:
        right = np.broadcast_to(right, (*M.shape[:-2], *right.shape))
    return np.asarray(np.linalg.solve(M, right))


@dataclass(frozen=True, eq=False)
class Question:
    """What a criterion may ask for when it is set up.

    model : Model
    T : ndarray, shape (p, p): values in SI are ``theta = T y``
    interest : ndarray, shape (s, p), combinations of the parameters, in their units, that matter, each
        of one parameter but for criterion c; None for all
    targets : ndarray, shape (K, r, p), rows of the K target poses: the squared error at target k is
        ``tr(rows_k cov rows_k^T)`` in m^2
    target_weights : ndarray, shape (K,), summing to one
    region : ndarray, shape (R, p, p), information of poses that stand for the reachable cell, in y
    rivals : tuple of two arrays of int, positions of two rival effects' parameters, or None
    """

    model: Model
    T: Array
    interest: Array | None
    targets: Array
    target_weights: Array
    region: Array
    rivals: tuple[IntArray, IntArray] | None = None

    @cached_property
    def shown(self) -> Array:
        """Rows V with ``parameters in their units = V y``, shape (p, p)."""
        units = np.array([p.scale for p in self.model.parameters])
        return np.asarray(self.T / units[:, None])

    @cached_property
    def sized(self) -> Array:
        """Rows V with ``parameters in plausible sizes = V y``, shape (p, p)."""
        return np.asarray(self.T / self.model.sizes[:, None])

    def chosen(self, V: Array, needed_by: str = "") -> Array:
        """Of rows V for all parameters (p, p) those for what matters, shape (s, p).

        needed_by : name of a criterion that is none without them. Raises CalibError for it.
        """
        if self.interest is None and needed_by:
            raise CalibError(
                f"criterion {needed_by} needs the parameters that matter; say which (of)"
            )
        return V if self.interest is None else self.interest @ V


class Criterion(InformationFunction):
    """An information function that a robot's question sets up, and that people read in a unit."""

    unit: ClassVar[str]
    larger_is_better: ClassVar[bool] = False
    whole: ClassVar[bool] = True
    """Whether every parameter must be determined where none matters more than others."""

    @property
    def plain(self) -> Criterion:
        """The criterion without what keeps the search away from singular plans."""
        return self

    @classmethod
    @abstractmethod
    def of(cls, question: Question) -> Self:
        """The criterion for a question. Raises CalibError where it lacks something."""

    def shown(self, value: float) -> float:
        """The value as people read it, in ``unit``: as it is, or one over it."""
        return value if self.larger_is_better else 1.0 / value


__all__ = ["Conic", "Criterion", "Question"]
