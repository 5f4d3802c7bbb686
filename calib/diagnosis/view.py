"""All candidates as seen from a fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib.diagnosis.candidates import Candidate
from calib.diagnosis.linear import LinearModel
from calib.diagnosis.screen import DEPENDENT, Field, beside, orthonormal
from calib.diagnosis.stage import Fit, Stage
from calib.poses import IntArray
from calib.se3 import Array


@dataclass(frozen=True, eq=False)
class Columns:
    """Derivatives of the readings by every candidate; fits that differ by errors have the same.

    J : ndarray, shape (m, M, 3, K), SI
    where : dict, candidate -> ndarray of int, its columns
    """

    J: Array
    where: dict[str, IntArray]

    def seen_from(self, stage: Stage, fit: Fit) -> View:
        """The candidates beside a fit, weighted as its poses are."""
        return View(fit, stage.observation(fit.model, fit.weight).rows(self.J), self.where)


@dataclass(frozen=True, eq=False)
class View:
    """All candidates as seen from a fit.

    fit : Fit; rows : ndarray, shape (m, R, K), whitened derivatives of every candidate
    where : dict, candidate -> ndarray of int, its columns
    """

    fit: Fit
    rows: Array
    where: dict[str, IntArray]

    @cached_property
    def columns(self) -> Array:
        """The same of independent rows, shape (m R, K)."""
        rows = self.rows if self.fit.mixing is None else self.fit.mixing(self.rows)
        return rows.reshape(-1, rows.shape[-1])

    @cached_property
    def modelled(self) -> Array:
        """An orthonormal basis of all that is modelled, shape (N, k)."""
        return orthonormal(self.fit.equations[1] @ self.fit.span)

    @cached_property
    def beside(self) -> Field:
        """Candidates and residual with all that is modelled projected out."""
        r, _ = self.fit.equations
        X = np.zeros((len(r), self.columns.shape[1]))
        X[: len(self.columns)] = self.columns
        return beside(self.modelled, X, r)

    @cached_property
    def _turned(self) -> tuple[Array, Array]:
        """What is modelled, and the candidates, in the directions of the basis."""
        Q, J = self.modelled, self.fit.equations[1] @ self.fit.span
        return Q.T @ J, Q[: len(self.columns)].T @ self.columns

    @cached_property
    def by_instrument(self) -> View:
        """The same as if nothing but the instrument erred."""
        return replace(self, fit=replace(self.fit, mixing=None))

    def without(self, member: Candidate) -> Field:
        """The same with one of the fitted effects out again, a candidate like the others.

        What it alone explains comes back, as rows of their own: lengths and products are those of
        ``X + U U^T X``, U the directions that it has beside the rest.
        """
        from scipy.linalg import qr

        fit, whole = self.fit, self.beside
        own = fit.positions(member.effect)
        rest = np.abs(fit.span[own]).sum(axis=0) == 0.0
        modelled, candidates = self._turned
        modelled = modelled[:, rest]
        scale = np.linalg.norm(modelled, axis=0)
        Q, R, _ = qr(modelled / np.where(scale > 0.0, scale, 1.0), pivoting=True)
        pivots = np.abs(np.diag(R))
        rank = int(np.count_nonzero(pivots > DEPENDENT * pivots.max(initial=0.0)))
        U = Q[:, rank:]
        # The residual as it would be without the effect, to first order.
        r, J = fit.equations
        r = r + J[:, own] @ fit.values[own]
        held = 0 if member.named else len(own)  # rows of its prior, which go with it
        return Field(
            U.T @ candidates,
            U.T @ (self.modelled.T @ r),
            whole.lengths,
            whole.rows - held,
            whole.dof + U.shape[1] - held,
            whole,
        )


def columns_at(stage: Stage, fit: Fit, suspects: Sequence[Candidate]) -> Columns:
    """Linearise every candidate at a fit; those that are in it stand where they are."""
    return columns_of(stage.about(fit, [c.effect for c in suspects]), suspects)


def columns_of(stage: Stage, suspects: Sequence[Candidate]) -> Columns:
    """The candidates' columns in a stage to first order."""
    whole = stage.model
    if not isinstance(whole, LinearModel):
        raise TypeError("the stage is not to first order")
    at = [whole.known[id(c.effect)] for c in suspects]
    ends = np.cumsum([0, *map(len, at)])
    where = {c.key: np.arange(a, b) for c, a, b in zip(suspects, ends, ends[1:], strict=False)}
    return Columns(whole.columns[..., np.concatenate(at)], where)
