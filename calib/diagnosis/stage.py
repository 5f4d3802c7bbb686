"""Fits of the model with effects added, and the view of all candidates from a fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.diagnosis.candidates import Candidate
from calib.diagnosis.screen import Field, field
from calib.effects.protocol import Effect
from calib.identify.estimators import choose_directions
from calib.identify.outliers import pose_statistics
from calib.identify.solver import levenberg_marquardt
from calib.model import Model
from calib.observations import Points
from calib.poses import IntArray, Measurements
from calib.se3 import Array

_HUBER = 2.0  # median lengths of a pose's residual beyond which it counts less
_ROUNDS = 4
_MOST_ITERATIONS = 20  # a model that needs more does not describe the arm


@dataclass(frozen=True, eq=False)
class Fit:
    """The model with effects added, fitted.

    model : Model; values : ndarray, shape (p,); span : ndarray, shape (p, k)
    weight : ndarray, shape (m,), of each pose, one where it counts in full
    r : ndarray, shape (m, rows), J : ndarray, shape (m, rows, p), whitened and weighted
    """

    model: Model
    values: Array
    span: Array
    weight: Array
    r: Array
    J: Array
    converged: bool


@dataclass(frozen=True, eq=False)
class Stage:
    """Data, the user's model, and where its search starts.

    model : Model, as the user has it; start : ndarray, shape (p,); weights : ndarray, (m, M, 3, 3)
    dropped : ndarray of bool, shape (m,), poses that are left out; robust : whether poses that stand
        out count less
    """

    data: Measurements
    model: Model
    start: Array
    weights: Array
    dropped: NDArray[np.bool_]
    robust: bool = True

    def observation(self, model: Model, weight: Array) -> Points:
        """Whitened points with a weight on every pose."""
        weights = self.weights * (weight * ~self.dropped)[:, None, None, None]
        return Points(model, self.data, weights)

    def fit(self, effects: Sequence[Effect]) -> Fit:
        """Fit from the nominal values: a fit without the effects may have wandered."""
        model = self.model.with_effects((*self.model.effects, *effects))
        start = np.concatenate([self.start, np.zeros(len(model.parameters) - len(self.start))])
        weight = np.ones(len(self.data))
        span = self._span(model, start, weight)
        for _ in range(_ROUNDS if self.robust else 1):
            observation = self.observation(model, weight)
            found = levenberg_marquardt(observation.flat, start, span, _MOST_ITERATIONS)
            start = found.values
            if not self.robust:
                break
            fresh = self._robust_weight(model, found.values, span)
            if np.abs(fresh - weight).max() < 1e-2:
                break
            weight = fresh
        r, J = self.observation(model, weight).linearise(found.values)
        return Fit(model, found.values, span, weight, r, J, bool(found.converged))

    def _span(self, model: Model, start: Array, weight: Array) -> Array:
        observation = self.observation(model, weight)
        return np.eye(len(start))[:, choose_directions(observation, start).kept]

    def _robust_weight(self, model: Model, values: Array, span: Array) -> Array:
        r, J = self.observation(model, np.ones(len(self.data))).linearise(values)
        statistic, _ = pose_statistics(r, J, ~self.dropped, span)
        length = np.sqrt(statistic)
        typical = float(np.median(length[~self.dropped]))
        return np.asarray(np.minimum(1.0, _HUBER * typical / np.maximum(length, 1e-12)))


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
        N, r = fit.J.reshape(-1, fit.J.shape[-1]) @ fit.span, fit.r.ravel()
        if without is not None:
            own = positions(fit.model, without.effect)
            # The residual as it would be without the effect, to first order.
            r = r + fit.J.reshape(len(r), -1)[:, own] @ fit.values[own]
            N = N[:, np.abs(fit.span[own]).sum(axis=0) == 0.0]
        return field(N, self.columns, r)


def view(stage: Stage, fit: Fit, suspects: Sequence[Candidate]) -> View:
    """Linearise every candidate at a fit; those that are in it stand where they are."""
    model = fit.model
    fitted = {id(e) for e in model.effects}
    extra = [c.effect for c in suspects if id(c.effect) not in fitted]
    whole = model.with_effects((*model.effects, *extra))
    values = np.concatenate([fit.values, np.zeros(len(whole.parameters) - len(fit.values))])
    _, J = whole.jacobian(values, stage.data.poses)
    rows = stage.observation(whole, fit.weight).rows(J)
    columns = rows.reshape(-1, rows.shape[-1])
    at = [positions(whole, c.effect) for c in suspects]
    ends = np.cumsum([0, *map(len, at)])
    where = {c.key: np.arange(a, b) for c, a, b in zip(suspects, ends, ends[1:], strict=False)}
    return View(fit, columns[:, np.concatenate(at)], where)


def positions(model: Model, effect: Effect) -> IntArray:
    """Where an effect's parameters stand in the vector of values."""
    for own, part in zip(model.effects, model.slices, strict=True):
        if own is effect:
            return np.arange(part.start, part.stop)
    raise KeyError(effect.where)
