"""Variances by restricted likelihood and their priors: every component, always.

The standard deviation s of an effect has a half-Cauchy prior with the scale A of its kind, from data
sheets (Gelman, Bayesian Analysis 1(3), 2006). The estimate is the mode of log s, so that it is never
zero (Chung, Rabe-Hesketh, Dorie, Gelman, Liu, Psychometrika 78(4), 2013):

    -2 log p(log s^2) = 2 log(1 + s^2 / A^2) - log s^2

Newton's method with average information moves the logarithms of all variances at once, by steps of
bounded length with Levenberg's damping. The best maximum from two starts counts; where variances of
nearly the same design are given, one search from these, or from a start that is likelier, goes on.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from calib.arrays import Array, Mask
from calib.inference.design import Design, Variances
from calib.inference.least_squares import solve
from calib.inference.restricted import MixedModel, RestrictedLikelihood

_STEPS = 60
_SETTLED = 1e-6  # decrease of -2 log L that is not worth another step
_LONGEST = 2.0  # change of a logarithm in one step
_DAMPING = 1e-9, 1e9
_FAINT, _HIGH = 1e-10, 1e2  # of the variance that moves the rows as the residual does
_LEAST = 1e-6  # of the residual variance: of an instrument
_SIZES = 1.0, 1e-2, 1e2  # of a free amplitude, at the start
_FEWEST = 10  # rows beyond the columns that say what an instrument's noise is
_NOTHING = 1e-300  # a variance whose logarithm is a number
_RUNS = 2  # starts that are followed to the end where none is given
_APART = 10.0  # -2 log L a row above the best start, at which the variances explain nothing


class Penalty(NamedTuple):
    """-2 log prior of log variances, its slope (t,) and its curvature (t,)."""

    value: float
    slope: Array
    curvature: Array


@dataclass(frozen=True, eq=False)
class Prior:
    """Priors of variances; kinds without a scale have none, and neither have amplitudes.

    scales : standard deviation of each kind of effect by data sheets, in the unit of the effect
    known : variance of each kind of effect that is not estimated
    instrument_least : float, variance of an instrument that is believed at least
    of_logarithm : whether the estimate is the mode of log s, which is never zero, or that of s
    """

    scales: Mapping[str, float] = field(default_factory=dict)
    known: Mapping[str, float] = field(default_factory=dict)
    instrument_least: float = 0.0
    of_logarithm: bool = True

    def of_effects(self, design: Design) -> Array:
        """Scale of each effect, shape (v,), infinite without one."""
        return np.array([self.scales.get(effect.kind, np.inf) for effect in design.effects])

    def penalty(self, design: Design, theta: Array) -> Penalty:
        """Of the variances theta (t,) of a design."""
        slope, curvature, scales = (
            np.zeros(len(theta)),
            np.zeros(len(theta)),
            self.of_effects(design),
        )
        known = np.flatnonzero(np.isfinite(scales))
        at = design.instruments + known
        ratio = theta[at] / scales[known] ** 2
        value = float(2.0 * np.log1p(ratio).sum())
        slope[at], curvature[at] = 2.0 * ratio / (1.0 + ratio), 2.0 * ratio / (1.0 + ratio) ** 2
        if self.of_logarithm:
            value -= float(np.log(np.maximum(ratio, 1e-300)).sum())
            slope[at] -= 1.0
        return Penalty(value, slope, curvature)


class Search(NamedTuple):
    """Where a search ended.

    theta : ndarray, shape (t,); objective : float, -2 log likelihood and penalty
    """

    theta: Array
    objective: float


@dataclass(frozen=True, eq=False)
class VarianceProblem:
    """Objective, two sets of starting values and the bounds of theta, shape (t,) each.

    The residual is the effects' as far as rows that carry noise alone allow, or it is all noise.
    """

    model: MixedModel
    prior: Prior
    begun: tuple[Array, Array]
    low: Array
    high: Array

    @classmethod
    def of(cls, model: MixedModel, prior: Prior) -> VarianceProblem:
        """Bounds by what moves the rows as much as least squares leave."""
        design, noise = model.design, _residual_variance(model.design)
        by_row = 1.0 / noise[design.instrument]
        power = np.array([(by_row @ design.flat(e.levers) ** 2).sum() for e in design.effects])
        rows = max(1, len(by_row))
        reached = np.divide(rows, power, out=np.zeros(len(power)), where=power > 0.0)
        scales = prior.of_effects(design)
        usual = np.where(np.isfinite(scales), scales**2, reached)
        reached = np.where(reached > 0.0, reached, usual)
        free, quiet = np.ones(len(design.free_blocks)), _noise_alone(model, noise)
        small = np.concatenate([quiet, 1e-2 * np.where(usual > 0.0, usual, 1.0), free])
        large = np.concatenate([quiet, np.maximum(usual, reached / max(1, len(power))), free])
        least = np.maximum(_LEAST * noise, prior.instrument_least)
        low = np.concatenate([least, _FAINT * np.minimum(reached, usual), _FAINT * free])
        highest = _HIGH * np.maximum(reached, _NOTHING)
        high = np.concatenate([_HIGH * np.maximum(noise, least), highest, free / _FAINT])
        for j, effect in enumerate(design.effects, start=design.instruments):
            if effect.kind in prior.known:
                low[j] = high[j] = max(prior.known[effect.kind], _NOTHING)
        return cls(model, prior, (large, small), low, np.maximum(high, low))

    def search(self, start: Variances | None = None) -> Search:
        """The best maximum of the penalised restricted likelihood.

        start : Variances, from an earlier search; without, two starts are followed
        """
        starts = list(self.starts(start))
        values = np.array([self.at(theta)[0] for theta in starts])
        likely = values <= values.min() + _APART * max(1, len(self.model.design.live))
        _, different = np.unique(np.where(likely, values, values.min()).round(9), return_index=True)
        ends = [self.descend(starts[i]) for i in different[: _RUNS if start is None else 1]]
        return min(ends, key=lambda one: round(one.objective, 5))

    def starts(self, given: Variances | None) -> Iterator[Array]:
        """Starting values: the given ones, and effects of large and of small size."""
        design = self.model.design
        first = design.instruments + len(design.effects)
        if given is not None:
            yield np.clip(design.theta(given), self.low, self.high)
        for own in self.begun:
            for size in _SIZES[: 3 if design.free_blocks else 1]:
                scale = np.where(np.arange(len(own)) < first, 1.0, size)
                yield np.clip(own * scale, self.low, self.high)

    def at(self, theta: Array) -> tuple[float, RestrictedLikelihood]:
        """-2 log likelihood with the penalty, and the likelihood, whose derivatives may follow."""
        likelihood = RestrictedLikelihood(self.model, theta)
        return likelihood.value + self.prior.penalty(self.model.design, theta).value, likelihood

    def curvature(self, likelihood: RestrictedLikelihood) -> tuple[Array, Array, Mask]:
        """Gradient (t,) and average information (t, t) of the objective, and what may move (t,).

        A variance at a bound that holds it does not move.
        """
        theta, (gradient, information) = likelihood.theta, likelihood.derivatives
        known = self.prior.penalty(self.model.design, theta)
        curvature = known.curvature + np.maximum(gradient, 0.0)  # as of log s^2 beside s^2
        gradient, information = gradient + known.slope, information + np.diag(curvature)
        held = (theta <= self.low) & (gradient > 0.0) | (theta >= self.high) & (gradient < 0.0)
        return gradient, information, ~held

    def descend(self, theta: Array, steps: int = _STEPS, settled: float = _SETTLED) -> Search:
        """Newton steps with average information, until one promises less than ``settled``."""
        (least, likelihood), damping = self.at(theta), _DAMPING[0]
        for _ in range(steps):
            gradient, information, inside = self.curvature(likelihood)
            while True:
                step = _step(gradient, information, inside, damping)
                trial = np.exp(np.clip(np.log(theta) + step, np.log(self.low), np.log(self.high)))
                promised = -float(gradient @ np.log(trial / theta))
                if promised < settled or damping > _DAMPING[1]:
                    return Search(theta, least)
                value, likelihood = self.at(trial)
                if value <= least:
                    break
                damping = max(10.0 * damping, 1e-2)
            theta, least, damping = trial, value, max(0.1 * damping, _DAMPING[0])
        return Search(theta, least)


def _step(gradient: Array, information: Array, inside: Mask, damping: float) -> Array:
    """Change of the logarithms, shape (t,), downhill, no component longer than the bound.

    Where a variance is so small that rows say little of it, its slope alone bounds its change.
    """
    A, g = information[np.ix_(inside, inside)], gradient[inside]
    known = np.diag(A)
    own = np.maximum(known * (1.0 + 1e-9 + damping), np.maximum(np.abs(g) / _LONGEST, 1e-300))
    size = np.sqrt(own)
    scaled = (A + np.diag(own - known)) / np.outer(size, size)
    step = np.zeros(len(gradient))
    step[inside] = -np.linalg.solve(scaled, g / size) / size
    return np.asarray(step / max(1.0, float(np.abs(step).max(initial=0.0)) / (2.0 * _LONGEST)))


def _residual_variance(design: Design) -> Array:
    """Mean square of what least squares leave of the rows of each instrument, shape (i,)."""
    amplitudes = design.amplitudes(np.ones(len(design.free_blocks)))
    y, columns = design.response, design.columns * design.column_scale(amplitudes)
    scale = float(np.sqrt((y**2).mean())) if len(y) else 1.0
    left = solve(columns, y, design.prior_rows * scale).residual
    spare = max(1.0 - design.directions.shape[1] / max(1, len(left)), 1e-3)
    rows = np.bincount(design.instrument, minlength=design.instruments)
    squares = np.bincount(design.instrument, left**2, design.instruments)
    variance = squares / np.maximum(rows, 1) / spare
    floor = 1e-20 * scale**2 if scale > 0.0 else 1.0
    return np.asarray(np.where(rows > 0, np.maximum(variance, floor), 1.0))


def _noise_alone(model: MixedModel, noise: Array) -> Array:
    """Variance of each instrument, shape (i,), by rows that carry noise alone, where these are many."""
    variance = noise.copy()
    for i, (R, rows) in enumerate(zip(model.outside, model.turned.outside, strict=True)):
        spare = int(rows) - np.linalg.matrix_rank(R[:-1, :-1])
        if spare >= _FEWEST:
            variance[i] = max(R[-1, -1] ** 2 / spare, _LEAST * noise[i])
    return variance


@dataclass(frozen=True, eq=False)
class Marginal:
    """A design at some variances: what follows for their spread, and for coefficients of blocks."""

    likelihood: RestrictedLikelihood
    prior: Prior

    @classmethod
    def fitted(
        cls, design: Design, prior: Prior | None = None, start: Variances | None = None
    ) -> Marginal:
        """At the variances that restricted likelihood gives; start : of an earlier search."""
        model, prior = MixedModel.of(design), prior or Prior()
        theta = VarianceProblem.of(model, prior).search(start).theta
        return cls(RestrictedLikelihood(model, theta), prior)

    def at(self, variances: Variances) -> Marginal:
        """The same at other variances."""
        theta = self.design.theta(variances)
        return replace(self, likelihood=RestrictedLikelihood(self.likelihood.model, theta))

    @property
    def design(self) -> Design:
        """As it was fitted."""
        return self.likelihood.model.design

    @cached_property
    def variances(self) -> Variances:
        """Of instruments, effects and blocks."""
        return self.design.variances(self.likelihood.theta)

    @property
    def log_likelihood(self) -> float:
        """Restricted log likelihood."""
        return -0.5 * self.likelihood.value

    @property
    def rows_of_noise(self) -> int:
        """How many rows carry the noise of instruments alone."""
        return int(self.likelihood.model.turned.outside.sum())

    @cached_property
    def log_covariance(self) -> Array:
        """Covariance (t, t) of the estimated log variances: instruments, effects, amplitudes^2.

        The second derivative of a likelihood L by log s^2 is ``s^4 L'' + s^2 L'``, and at the mode L'
        opposes the slope of the prior.
        """
        known = self.prior.penalty(self.design, self.likelihood.theta)
        own = np.diag(known.curvature + np.maximum(-known.slope, 0.0))
        A = self.likelihood.derivatives[1] + own
        size = np.sqrt(np.maximum(np.diag(A), 1e-12))
        scaled = A / np.outer(size, size) + 1e-12 * np.eye(len(A))
        return np.asarray(2.0 * np.linalg.inv(scaled) / np.outer(size, size))

    def posterior(self, name: str) -> tuple[Array, Array]:
        """Mean (k,) and covariance (k, k) of the coefficients of a block, given all rows."""
        number = [block.name for block in self.design.blocks].index(name)
        block, mine = self.design.blocks[number], self.design.block_of_column == number
        root = block.root * self.variances.amplitudes[number]
        half = root @ self.likelihood.inverse[mine]
        return block.mean + root @ self.likelihood.coefficients[mine], np.asarray(half @ half.T)
