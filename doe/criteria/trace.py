"""Criteria of the form ``tr(C M^-1)``: A, c, and the expected error at target poses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from calib.errors import CalibError
from calib.se3 import Array
from doe.criteria.protocol import Conic, Criterion, Question

_UNNEEDED = 1e-7  # share of the mean that every direction counts, needed at the targets or not


@dataclass(frozen=True, eq=False)
class Trace(Criterion):
    """``Phi = 1 / tr(F^T M^-1 F)``.

    F : ndarray, shape (p, r)
    """

    F: Array

    @property
    def whole(self) -> bool:
        return bool(np.linalg.matrix_rank(self.F) == len(self.F))

    def variance(self, M: Array) -> Array:
        """``tr(F^T M^-1 F)`` of matrices (..., p, p)."""
        return np.asarray(np.einsum("pr,...pr->...", self.F, np.linalg.solve(M, self.F)))

    def value(self, M: Array) -> Array:
        return 1.0 / self.variance(M)

    def gradient(self, M: Array) -> Array:
        W = np.linalg.solve(M, self.F)
        return np.asarray(self.value(M) ** 2 * W @ W.T)

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
                "criterion c needs one parameter or combination; give it with --of NAME[=FACTOR],.."
            )
        return cls((question.direction @ question.shown)[:, None])


@dataclass(frozen=True, eq=False)
class Task(Trace):
    """Expected squared position error after compensation, averaged over the target poses.

    The test-pose criterion ``rho_0^2 = tr(J_0 cov J_0^T)`` (Wu, Klimchik, Caro, Furet and Pashkevich,
    2012), shown as its root in mm. Directions that the targets do not need count a ten-millionth of the
    mean, so that among equals the plan that determines them is the better one; without this a single
    target is best measured at itself, with a singular M.
    """

    name: ClassVar[str] = "task"
    unit: ClassVar[str] = "mm RMS at the targets"

    @property
    def whole(self) -> bool:
        return True

    @classmethod
    def of(cls, question: Question) -> Self:
        rows = question.targets() * np.sqrt(question.target_weights)[:, None, None]
        rows = rows.reshape(-1, rows.shape[-1])
        least = np.sqrt(_UNNEEDED * (rows**2).sum() / len(question.T))
        rows = np.vstack([rows, least * np.eye(len(question.T))])
        _, singular, Vt = np.linalg.svd(rows, full_matrices=False)
        return cls(Vt.T * singular)

    def shown(self, value: float) -> float:
        return 1e3 / float(np.sqrt(value))
