"""Variances by restricted likelihood and their priors: every component, always.

Newton's method with average information moves the logarithms of all variances at once, by steps of
bounded length with Levenberg's damping. The best maximum from two starts counts; where variances of
nearly the same design are given, one search from these, or from a start that is likelier, goes on.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, Mask
from calib.inference.design import Design, Variances
from calib.inference.least_squares import solve
from calib.inference.prior import Prior, effect_scales, penalty
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


@dataclass(frozen=True, eq=False)
class Search:
    """Where a search ended.

    theta : ndarray, shape (t,); objective : float, -2 log likelihood and penalty
    converged : bool
    """

    theta: Array
    objective: float
    converged: bool


def reml(design: Design, prior: Prior | None = None, start: Variances | None = None) -> Variances:
    """Estimate the variances of a design."""
    return design.variances(search(MixedModel.of(design), prior or Prior(), start).theta)


def search(model: MixedModel, prior: Prior, start: Variances | None = None) -> Search:
    """The best maximum of the penalised restricted likelihood.

    start : Variances, from an earlier search; without, two starts are followed
    """
    problem = VarianceProblem.of(model, prior)
    starts = list(problem.starts(start))
    values = np.array([problem.at(theta)[0] for theta in starts])
    likely = values <= values.min() + _APART * max(1, len(model.design.live))
    _, different = np.unique(np.where(likely, values, values.min()).round(9), return_index=True)
    found = [problem.descend(starts[i]) for i in different[: _RUNS if start is None else 1]]
    return min(found, key=lambda one: round(one.objective, 5))


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
        design = model.design
        noise = _residual_variance(design)
        by_row = 1.0 / noise[design.instrument]
        rows = max(1, len(by_row))
        power = np.array([(by_row @ design.flat(e.levers) ** 2).sum() for e in design.effects])
        reached = np.divide(rows, power, out=np.zeros(len(power)), where=power > 0.0)
        scales = effect_scales(design, prior)
        usual = np.where(np.isfinite(scales), scales**2, reached)
        reached = np.where(reached > 0.0, reached, usual)
        free = np.ones(len(design.free_blocks))
        quiet = _noise_alone(model, noise)
        small = np.concatenate([quiet, 1e-2 * np.where(usual > 0.0, usual, 1.0), free])
        shared = np.maximum(usual, reached / max(1, len(power)))
        large = np.concatenate([quiet, shared, free])
        faint = np.minimum(reached, usual)
        least = np.maximum(_LEAST * noise, prior.instrument_least)
        low = np.concatenate([least, _FAINT * faint, _FAINT * free])
        high = np.concatenate(
            [_HIGH * np.maximum(noise, least), _HIGH * np.maximum(reached, _NOTHING), free / _FAINT]
        )
        for j, effect in enumerate(design.effects, start=design.instruments):
            if effect.kind in prior.known:
                low[j] = high[j] = max(prior.known[effect.kind], _NOTHING)
        return cls(model, prior, (large, small), low, np.maximum(high, low))

    def starts(self, given: Variances | None) -> Iterator[Array]:
        """Starting values: the given ones, and effects of large and of small size."""
        design = self.model.design
        i, v = design.instruments, len(design.effects)
        if given is not None:
            yield np.clip(design.theta(given), self.low, self.high)
        for own in self.begun:
            for size in _SIZES[: 3 if design.free_blocks else 1]:
                theta = own.copy()
                theta[i + v :] *= size
                yield np.clip(theta, self.low, self.high)

    def at(self, theta: Array) -> tuple[float, RestrictedLikelihood]:
        """-2 log likelihood with the penalty, and the likelihood, whose derivatives may follow."""
        likelihood = RestrictedLikelihood(self.model, theta)
        return likelihood.value + penalty(self.model.design, self.prior, theta).value, likelihood

    def curvature(self, likelihood: RestrictedLikelihood) -> tuple[Array, Array, Mask]:
        """Gradient (t,) and average information (t, t) of the objective, and what may move (t,)."""
        theta, (gradient, information) = likelihood.theta, likelihood.derivatives
        known = penalty(self.model.design, self.prior, theta)
        curvature = known.curvature + np.maximum(gradient, 0.0)  # as of log s^2 beside s^2
        gradient, information = gradient + known.slope, information + np.diag(curvature)
        return gradient, information, self._inside(theta, gradient)

    def descend(self, theta: Array, steps: int = _STEPS, settled: float = _SETTLED) -> Search:
        """Newton steps with average information, until one promises less than ``settled``."""
        (found, likelihood), damping = self.at(theta), _DAMPING[0]
        for _ in range(steps):
            gradient, information, inside = self.curvature(likelihood)
            while True:
                step = _step(gradient, information, inside, damping)
                trial = np.exp(np.clip(np.log(theta) + step, np.log(self.low), np.log(self.high)))
                promised = -float(gradient @ np.log(trial / theta))
                if promised < settled or damping > _DAMPING[1]:
                    return Search(theta, found, promised < settled)
                value, likelihood = self.at(trial)
                if value <= found:
                    break
                damping = max(10.0 * damping, 1e-2)
            theta, found, damping = trial, value, max(0.1 * damping, _DAMPING[0])
        return Search(theta, found, False)

    def _inside(self, theta: Array, gradient: Array) -> Mask:
        """Variances that may move: not those whose bound holds them."""
        held = ((theta <= self.low) & (gradient > 0.0)) | ((theta >= self.high) & (gradient < 0.0))
        return ~held


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
    columns = design.columns * design.column_scale(
        design.amplitudes(np.ones(len(design.free_blocks)))
    )
    scale = float(np.sqrt((design.response**2).mean())) if len(design.response) else 1.0
    left = solve(columns, design.response, design.prior_rows * scale).residual
    spare = max(1.0 - design.directions.shape[1] / max(1, len(left)), 1e-3)
    rows = np.bincount(design.instrument, minlength=design.instruments)
    found = (
        np.bincount(design.instrument, left**2, design.instruments) / np.maximum(rows, 1) / spare
    )
    floor = 1e-20 * scale**2 if scale > 0.0 else 1.0
    return np.asarray(np.where(rows > 0, np.maximum(found, floor), 1.0))


def _noise_alone(model: MixedModel, noise: Array) -> Array:
    """Variance of each instrument, shape (i,), by rows that carry noise alone, where these are many."""
    found = noise.copy()
    for i, (R, rows) in enumerate(zip(model.outside, model.turned.outside, strict=True)):
        spare = int(rows) - np.linalg.matrix_rank(R[:-1, :-1])
        if spare >= _FEWEST:
            found[i] = max(R[-1, -1] ** 2 / spare, _LEAST * noise[i])
    return found
