"""What is made large: an information function of the plan's information matrix.

``Phi(M)`` is concave, grows with M and is homogeneous of degree one: twice the measurements, twice the
value (Pukelsheim, Optimal Design of Experiments, 1993, chapter 5). From this alone follows the
certificate that all of ``doe`` rests on. At any positive definite M, with G a supergradient there,

    Phi(M') <= <G, M'>    for every information matrix M' ,

so no plan is better than the largest ``<G, M'>``, which a sort of the candidates finds.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from calib.arrays import Array
from doe.optimal.blocks import fall


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


class InformationFunction(ABC):
    """How much a plan tells, ``Phi(M)``: the more the better."""

    name: ClassVar[str]
    smooth: ClassVar[bool] = False
    ranked: ClassVar[bool] = False
    """Whether :meth:`brought` ranks candidates as the criterion does."""

    @abstractmethod
    def value(self, M: Array) -> Array:
        """``Phi(M)`` of positive definite matrices (..., p, p), shape (...)."""

    @abstractmethod
    def gradient(self, M: Array) -> Array:
        """A matrix G >= 0 of shape (p, p) with ``Phi(M') <= <G, M'>`` for all M', tight at M.

        Tight: ``<G, M> = Phi(M)``, nearly so for criteria with a kink.
        """

    def leaning(self, cov: Array) -> Array:
        """What ranks candidates beside a plan of covariance (p, p): the gradient, or smoother.

        In any scale, shape (p, p).
        """
        return self.gradient(np.asarray(np.linalg.inv(cov)))

    def brought(self, cov: Array, into: Array) -> Array:
        """What ranks candidates beside a plan that lacks a pose, however much they tell: shape (n,).

        By what they lower of a trace of the covariance, exact where the criterion is one.

        cov : ndarray, shape (p, p), without them; into : ndarray, shape (n, r, p), rows of each
        """
        return fall(cov, self.leaning(cov), into)

    @abstractmethod
    def conic(self, M: Any, at: Array) -> Conic:
        """The criterion in cvxpy.

        M : symmetric expression of shape (p, p)
        at : ndarray, shape (R, p, p), where it has been, the last one now
        """

    def curvature(self, M: Array, columns: Array) -> tuple[float, Array, Array]:
        """A convex cost of the same optimum over weights of columns, where ``smooth`` says so.

        columns : ndarray, shape (q, p, p)
        Returns the cost at M, its gradient (q,) and rows (q, k) with Hessian ``rows @ rows^T``.
        """
        raise NotImplementedError(f"criterion {self.name} is not smooth")
