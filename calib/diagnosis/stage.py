"""Fits of the model with effects added."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib.arrays import Array, IntArray, Mask
from calib.cell import Repeatability
from calib.diagnosis.linear import LinearModel, linearised
from calib.diagnosis.prior import Amplitudes, curves_in, prior_rows
from calib.effects.protocol import Effect
from calib.errors import Unsolvable
from calib.identification.components import variance_components
from calib.identification.estimators import choose_directions
from calib.identification.outliers import extrapolation_factor, fit_statistics, judge, threshold
from calib.linear import LinearProblem, huber_weights
from calib.model import Model
from calib.observations import Points
from calib.poses import Measurements
from calib.scatter import Scatter, VarianceEstimate, Variances, scatter_of
from calib.scatter.mixing import Mixing
from calib.solver import least_squares, levenberg_marquardt

_HUBER = 2.0  # median lengths of a pose's residual beyond which it counts less
_ROUNDS = 4
_SETTLED = 0.05
_ABSURD = 1e9  # times a plausible size, or what it was to first order
_MOST_ITERATIONS = 20  # a model that needs more does not describe the arm


@dataclass(frozen=True, eq=False)
class Fit:
    """The model with effects added, fitted.

    observation : Points, weighed by pose, beside what is known of causes and curves, and under the
        variances
    values : ndarray, shape (p,); span : ndarray, shape (p, k)
    weight : ndarray, shape (m,), of each pose, one where it counts in full
    amplitudes : dict, block -> size of its coefficients a priori
    r : ndarray, shape (m, rows), J : ndarray, shape (m, rows, p), whitened and weighted
    variances : Variances, of instrument and scatter
    levels : VarianceEstimate or None, where they were estimated about this fit
    """

    observation: Points
    values: Array
    span: Array
    weight: Array
    amplitudes: Amplitudes
    r: Array
    J: Array
    converged: bool
    variances: Variances
    levels: VarianceEstimate | None = None

    @property
    def model(self) -> Model:
        """As it was fitted."""
        return self.observation.model

    @property
    def mixing(self) -> Mixing | None:
        """What makes the rows independent under the variances; None where they are."""
        return self.observation.mixing

    @property
    def prior_weight(self) -> float:
        """By how many standard deviations of the instrument a row errs under the variances.

        One where nothing errs as a whole and nothing is known of the sizes of errors.
        """
        return self.observation.prior_weight

    @property
    def cost(self) -> float:
        """Sum of squares of the residuals."""
        return float((self.r**2).sum())

    @cached_property
    def rows(self) -> int:
        """How many count."""
        return int(np.count_nonzero(np.abs(self.J).sum(axis=-1)))

    @property
    def dof(self) -> int:
        """Degrees of freedom of the residuals."""
        return self.rows - self.spent

    @cached_property
    def linear(self) -> LinearProblem:
        """The fit to first order."""
        held = self.observation.stated_prior_residuals(self.values)
        return LinearProblem(
            self.r, self.J, self.span, *held, self.mixing, prior_weight=self.prior_weight
        )

    @property
    def covariance(self) -> Array:
        """Covariance of the values, shape (p, p), the noise as stated."""
        return self.linear.covariance

    @property
    def spent(self) -> int:
        """Parameters that the readings determine: what sizes of errors say of them is no reading."""
        rows = self.model.by_prior * (self.prior_weight if self.mixing is None else 1.0)
        by_prior = np.trace(rows @ self.covariance @ rows.T) if len(rows) else 0.0
        return int(self.span.shape[1]) - round(float(by_prior))

    def without(self, effects: Iterable[Effect]) -> Fit:
        """The fit to first order as if it had never had some of its effects: they are at nothing."""
        own = np.concatenate([self.positions(effect) for effect in effects])
        values = self.values.copy()
        values[own] = 0.0
        kept = np.abs(self.span[own]).sum(axis=0) == 0.0
        r = self.r + self.J[..., own] @ self.moving[own]
        return replace(self, values=values, span=self.span[:, kept], r=r)

    def by_instrument(self, r: Array, J: Array) -> Fit:
        """The same with other rows, (m, R) and (m, R, p), as if nothing but the instrument erred."""
        prior_weight = 1.0 if self.mixing is not None else self.prior_weight
        return replace(
            self,
            r=r,
            J=J,
            observation=replace(self.observation, scatter=None, prior_weight=prior_weight),
        )

    @property
    def moving(self) -> Array:
        """The values, shape (p,), tunings at zero, which are no amounts: rows are ``J @ moving``."""
        values = self.values.copy()
        values[self.model.tunings] = 0.0
        return values

    def positions(self, effect: Effect) -> IntArray:
        """Where an effect's parameters stand in the values."""
        return self.model.positions(effect)

    def std_of(self, amounts: IntArray) -> Array:
        """Standard deviations of some values, the noise as stated."""
        return np.sqrt(np.diag(self.covariance)[amounts])


@dataclass(frozen=True, eq=False)
class Stage:
    """A regression problem: data, the user's model, weights and starting values.

    model : Model, as the user has it; start : ndarray, shape (p,); weights : ndarray, (m, C, r, r)
    dropped : ndarray of bool, shape (m,), poses that are left out; robust : whether poses that stand
        out count less
    arm : Repeatability or None, where it is known
    """

    data: Measurements
    model: Model
    start: Array
    weights: Array
    dropped: Mask
    robust: bool = True
    arm: Repeatability | None = None

    @cached_property
    def scatter(self) -> Scatter:
        """How the poses may err together."""
        none = Variances.none(self.model.robot.dof)
        return scatter_of(self.model, self.start, self.data.poses, none)

    def observation(self, model: Model, weight: Array) -> Points:
        """Whitened points with a weight on every pose, shape (m,); dropped poses have none."""
        weights = self.weights * (weight * ~self.dropped)[:, None, None, None]
        return Points(model, self.data, weights)

    def fit(
        self,
        effects: Sequence[Effect],
        like: Fit | None = None,
        amplitudes: Amplitudes | None = None,
        variances: Variances | None = None,
    ) -> Fit:
        """Fit from the nominal values: a fit without the effects may have wandered.

        like : Fit, with whose weights the search for those of poses begins
        amplitudes : dict, block -> size of its coefficients a priori; one by default
        variances : Variances, under which the fit stands; those of the instrument as stated by default
        """
        weight = None if like is None else like.weight
        fit = self.weighted(effects, weight, amplitudes, variances)
        for _ in range(_ROUNDS if self.robust else 0):
            length = np.sqrt(self.statistics(fit))
            weight = huber_weights(length, float(np.median(length[~self.dropped])), _HUBER)
            if np.allclose(weight, fit.weight, atol=_SETTLED):
                break
            fit = self._fitted(
                fit.model, fit.values, fit.span, weight, fit.amplitudes, fit.variances
            )
        return fit

    def weighted(
        self,
        effects: Sequence[Effect],
        weight: Array | None = None,
        amplitudes: Amplitudes | None = None,
        variances: Variances | None = None,
    ) -> Fit:
        """The same with given weights of poses, shape (m,); one by default and without outliers."""
        model, values = self.model.extended(self.start, effects)
        full = np.ones(len(self.data))
        span = determined_by(self.observation(model, full), values)
        weight = full if weight is None or not self.robust else weight
        variances = variances or Variances.none(self.model.robot.dof)
        return self._fitted(model, values, span, weight, amplitudes or {}, variances)

    def exact(self, fit: Fit) -> Fit:
        """A fit to first order, gone on with in full, and the variances about it.

        Directions, weights and amplitudes stay.

        Raises Unsolvable where its values are no arm's.
        """
        if not isinstance(fit.model, LinearModel):
            return fit
        model = fit.model.exact
        span = self._with_tunings(model, fit)
        full = self._fitted(model, fit.values, span, fit.weight, fit.amplitudes, fit.variances)
        small = np.abs(full.values) <= _ABSURD * np.maximum(model.sizes, np.abs(fit.values))
        if not (small.all() and np.isfinite(full.r).all() and np.isfinite(full.J).all()):
            raise Unsolvable
        # A payload moves nothing where nothing that was found is elastic.
        moving = (full.J @ span).any(axis=tuple(range(full.J.ndim - 1)))
        return self._with_levels(replace(full, span=span[:, moving]))

    def _with_tunings(self, model: Model, fit: Fit) -> Array:
        """Directions (p, k) of a fit, and of the tunings that its amplitudes make visible."""
        free = np.setdiff1d(model.tunings, model.still)
        if not len(free):
            return fit.span
        span = np.concatenate([fit.span, np.eye(len(fit.values))[:, free]], axis=1)
        observation = self.observation(model, fit.weight)
        kept = choose_directions(observation, fit.values, span).kept
        held = np.arange(fit.span.shape[1])
        return np.asarray(span[:, np.union1d(held, kept)])

    def about(self, fit: Fit, suspects: Sequence[Effect]) -> Stage:
        """The same stage to first order about a fit, for it and all suspects."""
        read = self.data.read
        whole = linearised(fit.model, fit.values, self.data.poses, suspects, read)
        return replace(self, model=whole.with_effects(self.model.effects))

    def _fitted(
        self,
        model: Model,
        start: Array,
        span: Array,
        weight: Array,
        amplitudes: Amplitudes,
        variances: Variances,
    ) -> Fit:
        """A fit from a start (p,) on."""
        prior = prior_rows(model, amplitudes)
        observation = replace(self.observation(model, weight), prior=prior)
        observation = self._under(observation, variances)
        if isinstance(model, LinearModel):
            r, J = observation.flat(start)
            step = span @ least_squares(r, J @ span)
            r, J = observation.linearise(start)
            r, values, converged = r - J @ step, start + step, True
        else:
            found = levenberg_marquardt(observation.flat, start, span, _MOST_ITERATIONS)
            values, converged = found.values, bool(found.converged)
            r, J = observation.linearise(values)
        return Fit(observation, values, span, weight, amplitudes, r, J, converged, variances)

    def _under(self, observation: Points, variances: Variances) -> Points:
        """An observation under variances: what is known of sizes weighs as noisy rows do."""
        scatter, prior_weight = self.scatter.at(variances), 1.0
        if variances.any:
            prior_weight = scatter.typical(observation.rows(self.scatter.levers))
        elif observation.model.prior_rows:
            prior_weight = variances.scale
        return replace(observation, scatter=scatter, prior_weight=prior_weight)

    def _with_levels(self, fit: Fit) -> Fit:
        """The fit under the variances that its residual shows."""
        rows = fit.observation.rows(self.scatter.levers)
        found = variance_components(self.scatter, rows, fit.linear, self.model.robot, self.arm)
        observation = self._under(fit.observation, found.variances)
        return replace(fit, levels=found, variances=found.variances, observation=observation)

    def statistics(self, fit: Fit) -> Array:
        """Mean square of every pose's residual over its predicted variance, in full weight, (m,)."""
        r, J = self._in_full(fit)
        cov = fit.by_instrument(fit.r, fit.J).covariance
        return fit_statistics(r, J, fit.weight * ~self.dropped, cov)[0]

    def outliers(self, fit: Fit) -> tuple[Mask, Array, float]:
        """Poses that a fit does not explain, (m,), the statistic of every pose, (m,), and its limit."""
        plain, whole = self.statistics(fit), fit.by_instrument(*self._in_full(fit)).linear
        statistic = plain / extrapolation_factor(self.data.poses, whole, ~self.dropped, plain)
        limit = threshold(statistic, math.prod(self.weights.shape[-3:-1]))
        return judge(statistic, limit), statistic, limit

    def _in_full(self, fit: Fit) -> tuple[Array, Array]:
        """Whitened residuals (m, rows) and derivatives of every pose, none dropped or weighed down."""
        every = replace(self, dropped=np.zeros(len(self.data), dtype=bool))
        return every.observation(fit.model, np.ones(len(self.data))).linearise(fit.values)


def determined_by(observation: Points, start: Array) -> Array:
    """Directions (p, k) that the data determine, and all coefficients of curves: their prior does."""
    curved = np.zeros(len(start), dtype=bool)
    for _, part in curves_in(observation.model):
        curved[part] = True
    plain = np.eye(len(start))[:, ~curved]
    kept = choose_directions(observation, start, plain).kept
    return np.concatenate([plain[:, kept], np.eye(len(start))[:, curved]], axis=1)
