"""The profile likelihood of a suspect where the arm scatters: variances found anew with it.

Variances that were estimated while an effect is missing take the effect for noise, and its score at
those variances is too small. So the leading suspects are judged by the ratio of likelihoods, each
with its own variances: ``max L(levels, suspect) / max L(levels)``, of the same readings, once all
that is modelled is projected out of them (:mod:`calib.scatter.restricted`). Where nothing scatters
both are the score.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import prod

import numpy as np

from calib.arrays import Array, IntArray
from calib.diagnosis.candidates import Candidate
from calib.diagnosis.prior import held_rows
from calib.diagnosis.screen import CURVE_PRICE, NOTHING, VISIBLE, Score
from calib.diagnosis.stage import Stage
from calib.diagnosis.view import FitView
from calib.scatter.restricted import Turned, beside_known, maximised
from calib.scatter.search import VarianceEstimate, problem_of, searched

_AMPLITUDES = np.geomspace(1e-4, 1e2, 25)  # of a curve's plausible size
_TURNS = 2  # amplitude and variances in turn
_SETTLED = 0.1  # of -2 log likelihood


@dataclass(frozen=True, eq=False)
class LikelihoodProblem:
    """What is modelled, with the columns of some suspects.

    problem : Turned, of the modelled columns, the suspects' and the readings
    rows : int, that the arm moves, readings of one approach once: what a direction is paid by
    at : dict, key of a candidate -> ndarray of int, its columns in the problem
    search : what finds the levels without any suspect
    """

    problem: Turned
    rows: int
    at: dict[str, IntArray]
    search: Callable[[], VarianceEstimate]

    @cached_property
    def levels(self) -> VarianceEstimate:
        """Levels of noise without any of the suspects."""
        return self.search()

    def score(self, suspect: Candidate) -> Score:
        """What a suspect would explain, variances found anew."""
        if suspect.spread is None:
            return self.score_together([suspect])
        own = self.at[suspect.key]
        return self._curve(own, suspect.spread * suspect.effect.parameters[0].size ** 2)

    def score_together(self, causes: Sequence[Candidate]) -> Score:
        """What causes by name would explain beside each other, variances found anew."""
        from scipy.special import chdtrc

        own = np.concatenate([self.at[c.key] for c in causes])
        limits = np.concatenate([c.limits for c in causes])
        problem = self._with(own, np.diag(1.0 / limits))
        _, found = maximised(problem, self.levels.theta, self.levels.free, _SETTLED)
        told = found.diagonal[problem.known : -1] * limits
        fall = max(self.levels.value - found.value, 0.0)
        k = max(int(np.count_nonzero(told > 1.0 + VISIBLE)), 1)
        price = k * float(np.log(max(self.rows, 1)))
        own_score = Score(fall, fall, price, float(chdtrc(k, fall)))
        return own_score.counted(prod(c.choices for c in causes))

    def _curve(self, own: IntArray, spread: Array) -> Score:
        jitter = 1e-9 * float(np.diag(spread).mean()) * np.eye(len(spread))
        half = np.asarray(np.linalg.cholesky(spread + jitter))
        inverse = np.asarray(np.linalg.inv(half), dtype=np.float64)
        theta, best = self.levels.theta, (np.inf, 0.0)
        for _ in range(_TURNS):
            amplitude = _amplitude(beside_known(self._with(own), theta), half)
            problem = self._with(own, inverse / amplitude)
            theta, found = maximised(problem, theta, self.levels.free, _SETTLED)
            # -2 log marginal likelihood, and what the freedom of the coefficients costs.
            told = found.diagonal[problem.known : -1]
            price = 2.0 * float(np.log(told).sum() + np.log(amplitude * np.diag(half)).sum())
            best = min(best, (found.value + price, price))
        value, price = best
        evidence = self.levels.value - value
        if evidence <= 0.0:
            return NOTHING
        return Score(evidence + price, evidence, CURVE_PRICE, float(np.exp(-0.5 * evidence)))

    def _with(self, own: IntArray, prior: Array | None = None) -> Turned:
        """The problem with k columns beside the modelled ones, under rows of a prior (.., k)."""
        known = self.problem.known
        chosen = np.concatenate([np.arange(known), own, [self.problem.outside.shape[1] - 1]])
        held = self.problem.held[:, chosen]
        if prior is not None:
            held = np.concatenate([held, np.pad(prior, ((0, 0), (known, 1)))])
        return self.problem.with_columns(chosen, known, held)


def _amplitude(products: Array, half: Array) -> float:
    """That of a curve which the readings prefer, in plausible sizes.

    products : ndarray, shape (k + 1, k + 1), of its columns and the readings beside all else
    """
    d, vectors = np.linalg.eigh(half.T @ products[:-1, :-1] @ half)
    d = np.maximum(d, 0.0)
    squares = (vectors.T @ (half.T @ products[:-1, -1])) ** 2
    t = _AMPLITUDES[:, None] ** 2
    evidence = (squares * t / (1.0 + t * d) - np.log1p(t * d)).sum(axis=1)
    return float(_AMPLITUDES[int(np.argmax(evidence))])


def likelihood_problem(
    stage: Stage, view: FitView, suspects: Iterable[Candidate], without: Sequence[Candidate] = ()
) -> LikelihoodProblem:
    """The problem in which suspects are judged.

    without : candidates that are in the fit and are taken out of it
    """
    fit = view.fit.without([c.effect for c in without]) if without else view.fit
    span, r = fit.span, fit.r
    off, prior = held_rows(fit.model, fit.amplitudes, fit.values)
    of_prior = np.column_stack([prior @ span, off])
    of_prior = of_prior[of_prior.any(axis=1)]  # what is taken out takes its prior along
    chosen = list(suspects)
    columns = np.concatenate([view.where[c.key] for c in chosen]) if chosen else np.zeros(0, int)
    known = span.shape[1]
    weighted = stage.observation(fit.model, fit.weight).rows(stage.scatter.levers)
    wide = np.concatenate([fit.J @ span, view.rows[..., columns]], axis=-1)
    of_prior = np.insert(of_prior, [known] * len(columns), 0.0, axis=1)
    problem, start, may = problem_of(stage.scatter, weighted, r, wide, of_prior, stage.arm)
    levels = fit.levels

    def search() -> VarianceEstimate:
        if not without and levels is not None:
            return levels
        alone = problem.with_columns(np.append(np.arange(known), wide.shape[-1]), known)
        return searched(alone, start, may, stage.scatter, levels)

    problem = problem.with_columns(np.arange(wide.shape[-1] + 1), known)
    ends = known + np.cumsum([0, *(len(view.where[c.key]) for c in chosen)])
    at = {c.key: np.arange(a, b) for c, a, b in zip(chosen, ends, ends[1:], strict=False)}
    rows = int(np.count_nonzero(fit.J.any(axis=-1))) - problem.beyond_rigid
    return LikelihoodProblem(problem, rows, at, search)
