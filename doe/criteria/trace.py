"""Variances of parameters: the mean of them (A), one of them (c), and the form ``tr(C M^-1)``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from calib.arrays import Array
from calib.errors import CalibError
from doe.criteria.protocol import Conic, Criterion, Question, solved


@dataclass(frozen=True, eq=False)
class Trace(Criterion):
    """``Phi = 1 / tr(F^T M^-1 F)``.

    F : ndarray, shape (p, r)
    """

    F: Array
    smooth: ClassVar[bool] = True

    @property
    def whole(self) -> bool:
        return bool(np.linalg.matrix_rank(self.F) == len(self.F))

    def variance(self, M: Array) -> Array:
        """``tr(F^T M^-1 F)`` of matrices (..., p, p)."""
        return np.asarray(np.einsum("pr,...pr->...", self.F, solved(M, self.F)))

    def value(self, M: Array) -> Array:
        return 1.0 / self.variance(M)

    def gradient(self, M: Array) -> Array:
        W = solved(M, self.F)
        return np.asarray(W @ W.T / np.vdot(self.F, W) ** 2)

    def leaning(self, cov: Array) -> Array:
        W = cov @ self.F
        return np.asarray(W @ W.T)

    def conic(self, M: Any, at: Array) -> Conic:
        import cvxpy as cp

        F = self.F / np.linalg.norm(self.F)
        return Conic(-cp.matrix_frac(F, M))

    def shown(self, value: float) -> float:
        return 1.0 / value

    def curvature(self, M: Array, columns: Array) -> tuple[float, Array, Array]:
        scale = 1.0 / self.variance(M)
        L_inverse = np.linalg.inv(np.linalg.cholesky(M))
        half = L_inverse @ self.F  # the cost is |half|^2, scaled to one here
        P = L_inverse @ columns @ L_inverse.T
        moved = P @ half
        slope = -scale * np.einsum("qpr,pr->q", moved, half)
        return 1.0, slope, np.sqrt(2.0 * scale) * moved.reshape(len(P), -1)


@dataclass(frozen=True, eq=False)
class Average(Trace):
    """A: trace of the covariance, of all parameters or of those that matter, in their units."""

    name: ClassVar[str] = "A"
    unit: ClassVar[str] = "trace of the covariance, parameters in their units"

    @classmethod
    def of(cls, question: Question) -> Self:
        return cls(question.shown[question.chosen].T)


@dataclass(frozen=True, eq=False)
class Combination(Trace):
    """c: variance of one parameter or of one linear combination, in its units."""

    name: ClassVar[str] = "c"
    unit: ClassVar[str] = "variance of the combination, parameters in their units"

    @classmethod
    def of(cls, question: Question) -> Self:
        if question.direction is None:
            raise CalibError(
                "criterion c needs one parameter or combination; say which (of), as NAME[=FACTOR],.."
            )
        return cls((question.direction @ question.shown)[:, None])
