"""What a suspect is worth where the arm scatters: variances found anew with it and without it.

Variances that were estimated while an effect is missing take the effect for noise, and its score at
those variances is too small. So the leading suspects are judged by the ratio of likelihoods, each
with its own variances: ``max L(levels, suspect) / max L(levels)``, of the same readings, once all
that is modelled is projected out of them (:mod:`calib.scatter.restricted`). To second order that takes
no search and is never too much (:mod:`calib.scatter.nearby`): where it decides, it is enough. Where
nothing scatters both are the score.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib.arrays import Array, IntArray
from calib.diagnosis.candidates import Candidate
from calib.diagnosis.lineup import FitView
from calib.diagnosis.screen import CURVE_PRICE, NOTHING, Score
from calib.diagnosis.stage import Stage
from calib.evidence import VISIBLE, along_prior, cholesky_of, marginal_gain
from calib.scatter.nearby import NearbyLikelihood
from calib.scatter.restricted import MixedModel, maximised
from calib.scatter.search import VarianceEstimate, problem_of, searched

_AMPLITUDES = np.geomspace(1e-4, 1e2, 25)  # of a curve's plausible size
_TURNS = 2  # amplitude and variances in turn
_SETTLED = 0.1  # of -2 log likelihood


@dataclass(frozen=True, eq=False)
class LikelihoodProblem:
    """The restricted likelihood of noise levels, with the columns of some suspects.

    problem : MixedModel, of the modelled columns, the suspects' and the readings
    rows : int, that the arm moves, readings of one approach once: what a direction is paid by
    at : dict, key of a candidate -> ndarray of int, its columns in the problem
    nearby : NearbyLikelihood, the same at the levels of the fit
    search : what finds the levels without any suspect
    """

    problem: MixedModel
    rows: int
    at: dict[str, IntArray]
    nearby: NearbyLikelihood
    search: Callable[[], VarianceEstimate]

    @cached_property
    def levels(self) -> VarianceEstimate:
        """Levels of noise without any of the suspects."""
        return self.search()

    def score(self, suspect: Candidate, searched: bool = True) -> Score:
        """Likelihood ratio of a suspect, variances found anew.

        searched : whether they are searched for, else to second order
        """
        from scipy.special import chdtrc

        if suspect.spread is not None:
            return self._curve(suspect, suspect.spread, searched)
        own, limits = self.at[suspect.key], suspect.limits
        prior = np.diag(1.0 / limits)
        if searched:
            problem = self._with(own, prior)
            _, found = maximised(problem, self.levels.theta, self.levels.free, _SETTLED)
            fall, told = self.levels.value - found.value, found.diagonal[problem.known : -1]
        else:
            gain = self.nearby.gain(own, prior)
            fall, told = gain.fall + gain.promised, np.diag(gain.triangle)
        fall = max(fall, 0.0)
        # Of each parameter what the readings say of it beside its prior.
        k = max(int(np.count_nonzero(told * limits > 1.0 + VISIBLE)), 1)
        price, p = k * float(np.log(max(self.rows, 1))), float(chdtrc(k, fall))
        return Score(fall, fall, price, p).counted(suspect.choices)

    def _curve(self, curve: Candidate, spread: Array, searched: bool) -> Score:
        """Ratio of the marginal likelihood of a curve's coefficients, at its best amplitude."""
        own = self.at[curve.key]
        half = cholesky_of(spread * curve.effect.parameters[0].size ** 2)
        inverse = np.asarray(np.linalg.inv(half), dtype=np.float64)

        def amplitude_at(there: NearbyLikelihood) -> float:
            d, along = along_prior(*there.conditional(own), half)
            fall, price = marginal_gain(np.maximum(d, 0.0), along, _AMPLITUDES[:, None] ** 2)
            return float(_AMPLITUDES[int(np.argmax(fall - price))])

        def price_of(told: Array, amplitude: float) -> float:
            return 2.0 * float(np.log(told).sum() + np.log(amplitude * np.diag(half)).sum())

        if searched:
            theta, best = self.levels.theta, (np.inf, 0.0)
            for _ in range(_TURNS):
                there = NearbyLikelihood(self.problem, theta, self.levels.free)
                amplitude = amplitude_at(there)
                problem = self._with(own, inverse / amplitude)
                theta, found = maximised(problem, theta, self.levels.free, _SETTLED)
                price = price_of(found.diagonal[problem.known : -1], amplitude)
                best = min(best, (found.value + price, price))
            evidence, price = self.levels.value - best[0], best[1]
        else:
            amplitude = amplitude_at(self.nearby)
            gain = self.nearby.gain(own, inverse / amplitude)
            price = price_of(np.diag(gain.triangle), amplitude)
            evidence = gain.fall + gain.promised - price
        if evidence <= 0.0:
            return NOTHING
        return Score(evidence + price, evidence, CURVE_PRICE, float(np.exp(-0.5 * evidence)))

    def _with(self, own: IntArray, prior: Array) -> MixedModel:
        """The problem with k columns beside the modelled ones, under rows of a prior (.., k)."""
        known = self.problem.known
        chosen = np.concatenate([np.arange(known), own, [self.problem.outside.shape[1] - 1]])
        held = self.problem.held[:, chosen]
        rows = np.zeros((len(prior), len(chosen)))
        rows[:, known:-1] = prior
        return self.problem.with_columns(chosen, known, np.concatenate([held, rows]))


def likelihood_problem(
    stage: Stage, view: FitView, suspects: Iterable[Candidate], without: Sequence[Candidate] = ()
) -> LikelihoodProblem:
    """The problem in which suspects are judged.

    without : candidates that are in the fit and are taken out of it
    """
    fit = view.fit.without([c.effect for c in without]) if without else view.fit
    known = fit.span.shape[1]
    chosen = list(suspects)
    columns = np.concatenate([view.where[c.key] for c in chosen]) if chosen else np.zeros(0, int)
    weighted = fit.observation.rows(stage.scatter.levers)
    linear = fit.linear.with_columns(view.rows(columns))  # what is taken out takes its prior along
    problem = problem_of(stage.scatter, weighted, linear, stage.arm)
    levels = fit.levels
    free, theta = (levels.free, levels.theta) if levels else (problem.may[:0], problem.start)

    def search() -> VarianceEstimate:
        if not without and levels is not None:
            return levels
        alone = problem.with_columns(np.append(np.arange(known), known + len(columns)), known)
        return searched(alone, stage.scatter, levels)

    problem = problem.with_columns(np.arange(known + len(columns) + 1), known)
    ends = known + np.cumsum([0, *(len(view.where[c.key]) for c in chosen)])
    at = {c.key: np.arange(a, b) for c, a, b in zip(chosen, ends, ends[1:], strict=False)}
    rows = int(np.count_nonzero(fit.J.any(axis=-1))) - problem.beyond_rigid
    return LikelihoodProblem(problem, rows, at, NearbyLikelihood(problem, theta, free), search)
