"""All candidates as seen from a fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.diagnosis.candidates import Candidate
from calib.diagnosis.screen import Field, field
from calib.diagnosis.stage import Fit, Stage, positions
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
        rows = stage.observation(fit.model, fit.weight).rows(self.J)
        return View(fit, rows.reshape(-1, rows.shape[-1]), self.where)


@dataclass(frozen=True, eq=False)
class View:
    """All candidates as seen from a fit.

    fit : Fit; columns : ndarray, shape (rows, K), whitened derivatives of every candidate
    where : dict, candidate -> ndarray of int, its columns
    """

    fit: Fit
    columns: Array
    where: dict[str, IntArray]

    def beside(self, without: Candidate | None = None) -> Field:
        """Candidates and residual with all that is modelled projected out.

        without : one of the fitted effects, which then counts as a candidate like the others
        """
        fit = self.fit
        r, J = fit.equations
        span = fit.span
        if without is not None:
            own = fit.positions(without.effect)
            # The residual as it would be without the effect, to first order.
            r = r + J[:, own] @ fit.values[own]
            span = span[:, np.abs(span[own]).sum(axis=0) == 0.0]
        X = np.zeros((len(r), self.columns.shape[1]))
        X[: len(self.columns)] = self.columns
        return field(J @ span, X, r)


def columns_at(stage: Stage, fit: Fit, suspects: Sequence[Candidate]) -> Columns:
    """Linearise every candidate at a fit; those that are in it stand where they are."""
    model = fit.model
    fitted = {id(e) for e in model.effects}
    extra = [c.effect for c in suspects if id(c.effect) not in fitted]
    whole = model.with_effects((*model.effects, *extra))
    values = np.concatenate([fit.values, np.zeros(len(whole.parameters) - len(fit.values))])
    _, J = whole.jacobian(values, stage.data.poses)
    at = [positions(whole, c.effect) for c in suspects]
    ends = np.cumsum([0, *map(len, at)])
    where = {c.key: np.arange(a, b) for c, a, b in zip(suspects, ends, ends[1:], strict=False)}
    return Columns(J[..., np.concatenate(at)], where)
