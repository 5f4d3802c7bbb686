"""Volume of the confidence ellipsoid, of all parameters (D) or of those that matter (Ds)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np

from calib.arrays import Array
from doe.criteria.protocol import Conic, Criterion, Question, solved
from doe.optimal.blocks import logdet_increase, pack


@dataclass(frozen=True, eq=False)
class Subset(Criterion):
    """``Phi = det(K)^(1/s)``: K is the information on s parameters, with the others unknown.

    V : ndarray, shape (s, p): ``K = (V M^-1 V^T)^-1``, the Schur complement of M
    """

    V: Array
    name: ClassVar[str] = "Ds"
    whole: ClassVar[bool] = False
    unit: ClassVar[str] = "det(K)^(1/s), parameters in their units"
    larger_is_better: ClassVar[bool] = True

    @classmethod
    def of(cls, question: Question) -> Self:
        return cls(question.chosen(question.shown, needed_by="Ds"))

    def value(self, M: Array) -> Array:
        cov = self.V @ solved(M, self.V.T)
        return np.asarray(np.exp(-np.linalg.slogdet(cov)[1] / len(self.V)))

    def gradient(self, M: Array) -> Array:
        W = solved(M, self.V.T)
        return np.asarray(self.value(M) / len(self.V) * W @ np.linalg.solve(self.V @ W, W.T))

    def conic(self, M: Any) -> Conic:
        import cvxpy as cp

        V = self.V / np.linalg.norm(self.V, axis=1, keepdims=True)
        K = cp.Variable((len(V), len(V)), symmetric=True)
        return Conic(cp.log_det(K), [M - V.T @ K @ V >> 0])


@dataclass(frozen=True, eq=False)
class Determinant(Subset):
    """D: volume of the confidence ellipsoid, ``Phi = det(M)^(1/p)``, for parameters in their units.

    It is Ds of all parameters, V square.
    """

    name: ClassVar[str] = "D"
    whole: ClassVar[bool] = True
    unit: ClassVar[str] = "det(M)^(1/p), parameters in their units"
    smooth: ClassVar[bool] = True

    @classmethod
    def of(cls, question: Question) -> Self:
        return cls(question.shown)

    def value(self, M: Array) -> Array:
        return np.asarray(self._scale * np.exp(np.linalg.slogdet(M)[1] / M.shape[-1]))

    @cached_property
    def _scale(self) -> float:
        return float(np.exp(-2.0 * np.linalg.slogdet(self.V)[1] / len(self.V)))

    def gradient(self, M: Array) -> Array:
        return np.asarray(self.value(M) / len(M) * np.linalg.inv(M))

    def gain(self, cov: Array, rows: Array) -> Array:
        return logdet_increase(cov, rows)

    def conic(self, M: Any) -> Conic:
        import cvxpy as cp

        return Conic(cp.log_det(M))

    def curvature(self, M: Array, columns: Array) -> tuple[Array, Array]:
        # Of -log det(M).
        L_inverse = np.linalg.inv(np.linalg.cholesky(M))
        P = L_inverse @ columns @ L_inverse.T
        return -np.trace(P, axis1=-2, axis2=-1), pack(P)
