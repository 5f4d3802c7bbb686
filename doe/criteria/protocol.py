"""What a criterion is: an information function of the plan's information matrix.

A criterion ``Phi(M)`` is concave, grows with M and is homogeneous of degree one: twice the
measurements, twice the value (Pukelsheim, Optimal Design of Experiments, 1993, chapter 5). From this
alone follows the certificate that all of ``doe`` rests on. At any positive definite M, with G a
supergradient there,

    Phi(M') <= <G, M'>    for every information matrix M' ,

so no plan is better than the largest ``<G, M'>``, which a sort of the candidates finds. A new criterion
is one file with one such class and one entry in ``doe.criteria.CRITERIA``.

Matrices are in the coordinates y of ``theta = T y``, in which the mean information of the pool is the
identity; a criterion that speaks of the parameters themselves carries T.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np

from calib.model import Model
from calib.poses import IntArray
from calib.se3 import Array
from doe.packed import pack


@dataclass(frozen=True, eq=False)
class Question:
    """What a criterion may ask for when it is set up.

    model : Model
    T : ndarray, shape (p, p): values in SI are ``theta = T y``
    subset : ndarray of int, positions of the parameters that matter, None for all
    direction : ndarray, shape (p,), SI: the combination of parameters that matters, or None
    targets : callable returning ndarray, shape (K, r, p), the weighted rows of the K target poses: the
        squared error at target k is ``tr(rows_k cov rows_k^T)`` in m^2, its share of the mean already
        in the rows
    target_weights : ndarray, shape (K,), summing to one
    region : ndarray, shape (R, p, p), information of poses that stand for the reachable cell, in y
    rivals : tuple of two arrays of int, positions of two rival effects' parameters, or None
    """

    model: Model
    T: Array
    subset: IntArray | None
    direction: Array | None
    targets: Callable[[], Array]
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

    @cached_property
    def chosen(self) -> IntArray:
        """Positions of the parameters that matter."""
        return np.arange(len(self.T)) if self.subset is None else self.subset


@dataclass(frozen=True, eq=False)
class Conic:
    """A criterion for cvxpy.

    objective : expression to maximise, with the maximiser of the criterion; constraints : list
    witness : callable, after the solution: a supergradient taken from the dual variables, for criteria
        with a kink at the optimum; None where the gradient serves
    """

    objective: Any
    constraints: list[Any] = field(default_factory=list)
    witness: Callable[[], Array] | None = None


class Criterion(ABC):
    """How much a plan tells, ``Phi(M)``: the more the better."""

    name: ClassVar[str]
    unit: ClassVar[str]
    larger_is_better: ClassVar[bool] = False
    smooth: ClassVar[bool] = False

    @property
    def plain(self) -> Criterion:
        """The criterion without what keeps the search away from singular plans."""
        return self

    @property
    def whole(self) -> bool:
        """Whether every parameter must be determined; else a plan may leave some open."""
        return True

    @classmethod
    @abstractmethod
    def of(cls, question: Question) -> Self:
        """The criterion for a question. Raises CalibError where it lacks something."""

    @abstractmethod
    def value(self, M: Array) -> Array:
        """``Phi(M)`` of positive definite matrices (..., p, p), shape (...)."""

    @abstractmethod
    def gradient(self, M: Array) -> Array:
        """A matrix G >= 0 of shape (p, p) with ``Phi(M') <= <G, M'>`` for all M', tight at M.

        Tight: ``<G, M> = Phi(M)``, nearly so for criteria with a kink.
        """

    def screen(self, base: Array, packed: Array, rank: int) -> Array:
        """Upper bound on ``Phi(base + M_j)`` of packed candidates, shape (n,): the gradient at base.

        base : ndarray, shape (p, p); rank : int, of every M_j at most
        """
        G = self.gradient(base)
        return np.asarray(packed @ pack(G) + (G * base).sum())

    @abstractmethod
    def conic(self, M: Any, at: Array) -> Conic:
        """The criterion in cvxpy.

        M : symmetric expression of shape (p, p)
        at : ndarray, shape (R, p, p), where it has been, the last one now
        """

    @abstractmethod
    def shown(self, value: float) -> float:
        """The value as people read it, in ``unit``."""

    def curvature(self, M: Array, columns: Array) -> tuple[float, Array, Array]:
        """A convex cost of the same optimum over weights of columns, where ``smooth`` says so.

        columns : ndarray, shape (q, p, p)
        Returns the cost at M, its gradient (q,) and rows (q, k) with Hessian ``rows @ rows^T``.
        """
        raise NotImplementedError(f"criterion {self.name} is not smooth")
