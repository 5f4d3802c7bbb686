"""What is made large: an information function of the plan's information matrix.

``Phi(M)`` is concave, grows with M and is homogeneous of degree one: twice the measurements, twice the
value (Pukelsheim, Optimal Design of Experiments, 1993, chapter 5). From this alone follows the
certificate that all of ``doe`` rests on. At any positive definite M, with G a supergradient there,

    Phi(M') <= <G, M'>    for every information matrix M' ,

so no plan is better than ``<G, M_fixed>`` and the largest sum of ``<G, M_i>``, which a sort of the
candidates finds. Nothing is assumed of where M came from, so a solver's inaccuracy can make the bound
loose, never wrong.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from calib.arrays import Array, IntArray
from doe.optimal.allowed import Allowed
from doe.optimal.blocks import Blocks, trace_decrease


@dataclass(frozen=True, eq=False)
class Conic:
    """A criterion for cvxpy.

    objective : expression to maximise, with the maximiser of the criterion; constraints : list
    witness : callable, after the solution: a supergradient from the dual variables, for criteria with a
        kink at the optimum; None where the gradient serves
    """

    objective: Any
    constraints: list[Any] = field(default_factory=list)
    witness: Callable[[], Array] | None = None


class InformationFunction(ABC):
    """How much a plan tells, ``Phi(M)``: the more the better."""

    name: ClassVar[str]
    smooth: ClassVar[bool] = False

    @abstractmethod
    def value(self, M: Array) -> Array:
        """``Phi(M)`` of positive definite matrices (..., p, p), shape (...)."""

    @abstractmethod
    def gradient(self, M: Array) -> Array:
        """A matrix G >= 0 of shape (p, p) with ``Phi(M') <= <G, M'>`` for all M', tight at M.

        Tight: ``<G, M> = Phi(M)``, nearly so for criteria with a kink.
        """

    def gain(self, cov: Array, rows: Array) -> Array:
        """What ranks candidates beside a plan that lacks a pose, however much they tell, shape (n,).

        cov : ndarray, shape (p, p), of that plan; rows : ndarray, shape (n, r, p), of each candidate
        """
        return trace_decrease(cov, self.gradient(np.asarray(np.linalg.inv(cov))), rows)

    @property
    def conical(self) -> bool:
        """Whether there is a :meth:`conic` form; without it, and not ``smooth``, bounds are loose."""
        return type(self).conic is not InformationFunction.conic

    def conic(self, M: Any) -> Conic:
        """The criterion in cvxpy of a symmetric expression M of shape (p, p)."""
        raise NotImplementedError(f"criterion {self.name} has no cone form")

    def curvature(self, M: Array, columns: Array) -> tuple[Array, Array]:
        """Of a convex cost of the same optimum over weights of columns, where ``smooth`` says so.

        columns : ndarray, shape (q, p, p)
        Returns the gradient at M, (q,), and rows (q, k) with Hessian ``rows @ rows^T``.
        """
        raise NotImplementedError(f"criterion {self.name} is not smooth")


@dataclass(frozen=True, eq=False)
class Selection:
    """The choice of a plan: what is made large, what each candidate brings, which sets make a plan.

    criterion : InformationFunction; blocks : Blocks, of n candidates; allowed : Allowed, over them
    """

    criterion: InformationFunction
    blocks: Blocks
    allowed: Allowed

    def __len__(self) -> int:
        return len(self.blocks)

    def take(self, index: IntArray) -> Selection:
        """The same over some of the candidates."""
        return replace(self, blocks=self.blocks.take(index), allowed=self.allowed.take(index))

    def value(self, plan: IntArray) -> float:
        """The criterion of a plan."""
        return float(self.criterion.value(self.blocks.total(plan)))

    def proof(self, G: Array) -> tuple[float, Array, Array]:
        """What no plan's criterion is above, the supergradient G (p, p), and all scores by it, (n,)."""
        scores = self.blocks.scores(G)
        return float((G * self.blocks.fixed).sum()) + self.allowed.best(scores)[0], G, scores

    def bound(self, G: Array) -> float:
        """No plan has a larger criterion than this, G, shape (p, p), being a supergradient."""
        return self.proof(G)[0]
