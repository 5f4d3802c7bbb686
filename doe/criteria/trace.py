"""Traces ``tr(C M^-1)``: accuracy at the targets (task), variances of parameters (A, c)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from calib.arrays import Array, stacked
from calib.errors import CalibError
from doe.criteria.protocol import Conic, Criterion, Question, solved
from doe.optimal.blocks import pack, trace_decrease

_UNNEEDED = 1e-7  # share of the mean that every direction counts, needed at the targets or not


@dataclass(frozen=True, eq=False)
class Trace(Criterion):
    """``Phi = 1 / tr(F^T M^-1 F)``.

    F : ndarray, shape (p, r)
    """

    F: Array
    smooth: ClassVar[bool] = True

    def variance(self, M: Array) -> Array:
        """``tr(F^T M^-1 F)`` of matrices (..., p, p)."""
        return np.asarray(np.einsum("pr,...pr->...", self.F, solved(M, self.F)))

    def value(self, M: Array) -> Array:
        return 1.0 / self.variance(M)

    def gradient(self, M: Array) -> Array:
        W = solved(M, self.F)
        return np.asarray(W @ W.T / np.vdot(self.F, W) ** 2)

    def gain(self, cov: Array, rows: Array) -> Array:
        W = cov @ self.F
        return trace_decrease(cov, W @ W.T, rows)

    def conic(self, M: Any) -> Conic:
        import cvxpy as cp

        F = self.F / np.linalg.norm(self.F)
        return Conic(-cp.matrix_frac(F, M))

    def curvature(self, M: Array, columns: Array) -> tuple[Array, Array]:
        # Of the variance, one at M, in the axes in which both M and its price are diagonal.
        L_inverse = np.linalg.inv(np.linalg.cholesky(M))
        half = L_inverse @ self.F
        price, axes = np.linalg.eigh(half @ half.T / self.variance(M))
        turn = axes.T @ L_inverse
        P, price = turn @ columns @ turn.T, np.maximum(price, 0.0)
        return -np.einsum("qkk,k->q", P, price), pack(P * np.sqrt(price[:, None] + price))


@dataclass(frozen=True, eq=False)
class Average(Trace):
    """A: trace of the covariance, of all parameters or of those that matter, in their units."""

    name: ClassVar[str] = "A"
    unit: ClassVar[str] = "trace of the covariance, parameters in their units"

    @classmethod
    def of(cls, question: Question) -> Self:
        return cls(question.chosen(question.shown).T)


@dataclass(frozen=True, eq=False)
class Combination(Average):
    """c: variance of one parameter or of one linear combination, in its units."""

    name: ClassVar[str] = "c"
    whole: ClassVar[bool] = False
    unit: ClassVar[str] = "variance of the combination, parameters in their units"

    @classmethod
    def of(cls, question: Question) -> Self:
        return cls(question.chosen(question.shown, needed_by="c").T)


@dataclass(frozen=True, eq=False)
class Task(Trace):
    """Expected squared position error after compensation, averaged over the target poses.

    This is the test-pose criterion ``rho_0^2 = tr(J_0 cov J_0^T)`` (Wu, Klimchik, Caro, Furet and
    Pashkevich, 2012), shown as its root in mm. Parameter directions that the targets do not need count
    too, with a ten-millionth of the mean. Of equal plans the one that determines them is then better.
    Without this, a single target is best measured at itself, with a singular M.

    without : Task without that share, by which plans are judged
    """

    without: Task | None = None
    name: ClassVar[str] = "task"
    unit: ClassVar[str] = "mm RMS at the targets"

    @classmethod
    def of(cls, question: Question) -> Self:
        rows = question.targets * np.sqrt(question.target_weights)[:, None, None]
        if not rows.any():
            raise CalibError(
                "nothing in the model moves the targets, so that every plan is as good there; add "
                "effects to [model] effects, or take another criterion"
            )
        return cls.of_rows(stacked(rows))

    @classmethod
    def of_rows(cls, rows: Array) -> Self:
        """The criterion ``tr(rows cov rows^T)``, rows : ndarray, shape (k, p), m per y.

        Where they are nothing all directions count alike.
        """
        p = rows.shape[1]
        least = np.sqrt(_UNNEEDED * (rows**2).sum() / p) or 1.0
        plain = cls(_root(rows)) if rows.any() else None
        return cls(_root(np.vstack([rows, least * np.eye(p)])), plain)

    @property
    def plain(self) -> Criterion:
        return self if self.without is None else self.without

    def shown(self, value: float) -> float:
        return 1e3 / float(np.sqrt(value))


def _root(rows: Array) -> Array:
    """F of as few columns as can be with ``F F^T = rows^T rows``."""
    _, singular, Vt = np.linalg.svd(rows, full_matrices=False)
    kept = singular > 1e-12 * singular[0]
    return np.asarray(Vt[kept].T * singular[kept])
