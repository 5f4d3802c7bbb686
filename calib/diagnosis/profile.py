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
from math import prod

import numpy as np

from calib.arrays import Array, IntArray
from calib.diagnosis.candidates import Candidate
from calib.diagnosis.lineup import FitView
from calib.diagnosis.screen import CURVE_PRICE, NOTHING, Score
from calib.diagnosis.stage import Stage
from calib.evidence import VISIBLE, along_prior, cholesky_of, marginal_gain
from calib.linear import LinearProblem
from calib.scatter.nearby import NearbyLikelihood
from calib.scatter.restricted import Likelihood, Turned, maximised
from calib.scatter.search import VarianceEstimate, problem_of, searched

_AMPLITUDES = np.geomspace(1e-4, 1e2, 25)  # of a curve's plausible size
_TURNS = 2  # amplitude and variances in turn
_SETTLED = 0.1  # of -2 log likelihood


@dataclass(frozen=True, eq=False)
class LikelihoodProblem:
    """The restricted likelihood of noise levels, with the columns of some suspects.

    problem : Turned, of the modelled columns, the suspects' and the readings
    rows : int, that the arm moves, readings of one approach once: what a direction is paid by
    at : dict, key of a candidate -> ndarray of int, its columns in the problem
    nearby : NearbyLikelihood, the same at the levels of the fit
    search : what finds the levels without any suspect
    """

    problem: Turned
    rows: int
    at: dict[str, IntArray]
    nearby: NearbyLikelihood
    search: Callable[[], VarianceEstimate]

    @cached_property
    def levels(self) -> VarianceEstimate:
        """Levels of noise without any of the suspects."""
        return self.search()

    def approximate_score(self, suspect: Candidate) -> Score:
        """What a suspect would explain, variances found anew to second order."""
        if suspect.spread is None:
            return self.approximate_together([suspect])
        own = self.at[suspect.key]
        half = cholesky_of(suspect.spread * suspect.effect.parameters[0].size ** 2)
        amplitude = _amplitude(*self.nearby.conditional(own), half)
        gain = self.nearby.gain(own, _inverse(half) / amplitude)
        price = _freedom(np.diag(gain.triangle), half, amplitude)
        return _of_curve(gain.fall + gain.promised - price, price)

    def approximate_together(self, causes: Sequence[Candidate]) -> Score:
        """Approximate score of several named causes together."""
        own, limits = self._columns_of(causes)
        gain = self.nearby.gain(own, np.diag(1.0 / limits))
        told = np.diag(gain.triangle) * limits
        fall = max(gain.fall + gain.promised, 0.0)
        return self._priced(fall, told).counted(prod(c.choices for c in causes))

    def score(self, suspect: Candidate) -> Score:
        """Likelihood ratio of a suspect, the variances estimated with and without it."""
        if suspect.spread is None:
            return self.score_together([suspect])
        own = self.at[suspect.key]
        return self._curve(own, suspect.spread * suspect.effect.parameters[0].size ** 2)

    def score_together(self, causes: Sequence[Candidate]) -> Score:
        """What causes by name would explain beside each other, variances found anew."""
        own, limits = self._columns_of(causes)
        problem = self._with(own, np.diag(1.0 / limits))
        _, found = maximised(problem, self.levels.theta, self.levels.free, _SETTLED)
        told = found.diagonal[problem.known : -1] * limits
        fall = max(self.levels.value - found.value, 0.0)
        return self._priced(fall, told).counted(prod(c.choices for c in causes))

    def _columns_of(self, causes: Sequence[Candidate]) -> tuple[IntArray, Array]:
        """Columns (k,) of some causes by name, and the limits (k,) of their parameters."""
        own = np.concatenate([self.at[c.key] for c in causes])
        return own, np.concatenate([c.limits for c in causes])

    def _priced(self, fall: float, told: Array) -> Score:
        """Score of a named cause.

        told : ndarray, shape (k,), what the readings and the prior say of each parameter, in its limit
        """
        from scipy.special import chdtrc

        k = max(int(np.count_nonzero(told > 1.0 + VISIBLE)), 1)
        return Score(fall, fall, k * float(np.log(max(self.rows, 1))), float(chdtrc(k, fall)))

    def _curve(self, own: IntArray, spread: Array) -> Score:
        half = cholesky_of(spread)
        inverse = _inverse(half)
        theta, best = self.levels.theta, (np.inf, 0.0)
        for _ in range(_TURNS):
            there = NearbyLikelihood(self.problem, theta, self.levels.free)
            amplitude = _amplitude(*there.conditional(own), half)
            problem = self._with(own, inverse / amplitude)
            theta, found = maximised(problem, theta, self.levels.free, _SETTLED)
            best = min(best, _marginal(problem, found, half, amplitude))
        value, price = best
        return _of_curve(self.levels.value - value, price)

    def _with(self, own: IntArray, prior: Array) -> Turned:
        """The problem with k columns beside the modelled ones, under rows of a prior (.., k)."""
        known = self.problem.known
        chosen = np.concatenate([np.arange(known), own, [self.problem.outside.shape[1] - 1]])
        held = self.problem.held[:, chosen]
        rows = np.zeros((len(prior), len(chosen)))
        rows[:, known:-1] = prior
        return self.problem.with_columns(chosen, known, np.concatenate([held, rows]))


def _inverse(half: Array) -> Array:
    return np.asarray(np.linalg.inv(half), dtype=np.float64)


def _of_curve(evidence: float, price: float) -> Score:
    if evidence <= 0.0:
        return NOTHING
    return Score(evidence + price, evidence, CURVE_PRICE, float(np.exp(-0.5 * evidence)))


def _amplitude(S: Array, z: Array, half: Array) -> float:
    """That of a curve which the readings prefer, in plausible sizes; their products (k, k) and (k,)."""
    d, along = along_prior(S, z, half)
    fall, price = marginal_gain(np.maximum(d, 0.0), along, _AMPLITUDES[:, None] ** 2)
    return float(_AMPLITUDES[int(np.argmax(fall - price))])


def _marginal(
    problem: Turned, found: Likelihood, half: Array, amplitude: float
) -> tuple[float, float]:
    """-2 log marginal likelihood with a curve's coefficients, and what their freedom costs."""
    price = _freedom(found.diagonal[problem.known : -1], half, amplitude)
    return found.value + price, price


def _freedom(told: Array, half: Array, amplitude: float) -> float:
    """What the freedom of a curve's coefficients costs; told : diagonal of their triangle."""
    return 2.0 * float(np.log(told).sum() + np.log(amplitude * np.diag(half)).sum())


def likelihood_problem(
    stage: Stage, view: FitView, suspects: Iterable[Candidate], without: Sequence[Candidate] = ()
) -> LikelihoodProblem:
    """The problem in which suspects are judged.

    without : candidates that are in the fit and are taken out of it
    """
    fit = view.fit.without([c.effect for c in without]) if without else view.fit
    linear, known = fit.linear, fit.span.shape[1]
    chosen = list(suspects)
    columns = np.concatenate([view.where[c.key] for c in chosen]) if chosen else np.zeros(0, int)
    weighted = fit.observation.rows(stage.scatter.levers)
    wide = np.concatenate([fit.J @ fit.span, view.rows(columns)], axis=-1)
    held = linear.held @ fit.span
    shown = held.any(axis=1) | (linear.off != 0.0)  # what is taken out takes its prior along
    problem, start, may = problem_of(
        stage.scatter,
        weighted,
        LinearProblem(
            fit.r,
            wide,
            np.eye(wide.shape[-1]),
            linear.off[shown],
            np.pad(held[shown], ((0, 0), (0, len(columns)))),
        ),
        stage.arm,
    )
    levels = fit.levels
    free, theta = (levels.free, levels.theta) if levels is not None else (may[:0], start)

    def search() -> VarianceEstimate:
        if not without and levels is not None:
            return levels
        alone = problem.with_columns(np.append(np.arange(known), wide.shape[-1]), known)
        return searched(alone, start, may, stage.scatter, levels)

    problem = problem.with_columns(np.arange(wide.shape[-1] + 1), known)
    ends = known + np.cumsum([0, *(len(view.where[c.key]) for c in chosen)])
    at = {c.key: np.arange(a, b) for c, a, b in zip(chosen, ends, ends[1:], strict=False)}
    rows = int(np.count_nonzero(fit.J.any(axis=-1))) - problem.beyond_rigid
    return LikelihoodProblem(problem, rows, at, NearbyLikelihood(problem, theta, free), search)
