"""Fits of the model with effects added."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib.arrays import Array, IntArray, Mask
from calib.cell import Repeatability
from calib.diagnosis.prior import Amplitudes, curves_in, prior_rows
from calib.effects.protocol import Effect
from calib.errors import Unsolvable
from calib.identification.fit import choose_directions
from calib.identification.outliers import extrapolation_factor, judge, pose_statistics, threshold
from calib.identification.variances import VarianceEstimate, variance_components
from calib.inference.decorrelation import InverseRoot
from calib.model import Model
from calib.observations import Points
from calib.observations.linear import LinearProblem
from calib.observations.scatter import Scatter, Variances, scatter_of
from calib.poses import Measurements
from calib.solver import FIRST_DAMPING, Minimum, levenberg_marquardt

_ABSURD = 1e9  # times a plausible size
_ITERATIONS = 8, 100  # at least and at most
_WORK = 1e7  # rows times values times iterations: of large tables as many as a few seconds allow
_DAMPED = 1e-3  # first step of a fit with tunings: many at once go too far by a whole one


@dataclass(frozen=True, eq=False)
class Fit:
    """The model with effects added, fitted.

    observation : Points, beside what is known of causes and curves, and under the variances
    values : ndarray, shape (p,); span : ndarray, shape (p, k)
    amplitudes : dict, block -> size of its coefficients a priori
    r : ndarray, shape (m, rows), J : ndarray, shape (m, rows, p), whitened
    variances : Variances, of instrument and scatter
    levels : VarianceEstimate or None, where they were estimated about this fit
    """

    observation: Points
    values: Array
    span: Array
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
    def mixing(self) -> InverseRoot | None:
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

    @property
    def by_instrument(self) -> LinearProblem:
        """The fit to first order, as if nothing but the instrument erred."""
        prior_weight = 1.0 if self.mixing is not None else self.prior_weight
        return replace(self.linear, mixing=None, prior_weight=prior_weight)

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
    dropped : ndarray of bool, shape (m,), poses that are left out
    arm : Repeatability or None, where it is known
    """

    data: Measurements
    model: Model
    start: Array
    weights: Array
    dropped: Mask
    arm: Repeatability | None = None

    @cached_property
    def scatter(self) -> Scatter:
        """How the poses may err together."""
        none = Variances.none(self.model.robot.dof)
        return scatter_of(self.model, self.start, self.data.poses, none)

    def observation(self, model: Model) -> Points:
        """Whitened points; dropped poses have no weight."""
        return Points(model, self.data, self.weights * ~self.dropped[:, None, None, None])

    def fit(
        self,
        effects: Sequence[Effect] = (),
        values: Array | None = None,
        amplitudes: Amplitudes | None = None,
        variances: Variances | None = None,
    ) -> Fit:
        """The user's model with further effects, fitted.

        values : ndarray, shape (p,), of the user's parameters, from which to go on; the start without
        amplitudes : dict, block -> size of its coefficients a priori; one by default
        variances : Variances, under which the fit stands; those of the instrument as stated by default
        Where a tuning runs away all stay as they are.

        Raises Unsolvable where the values found are no arm's.
        """
        model, values = self.model.extended(self.start if values is None else values, effects)
        sizes, variances = amplitudes or {}, variances or Variances.none(self.model.robot.dof)
        observation = replace(self.observation(model), prior=prior_rows(model, sizes))
        observation = self._under(observation, variances)
        span, free = determined_by(observation, values), np.setdiff1d(model.tunings, model.still)
        found = None
        if len(free):
            # Only once there is an amount do the readings tell of a tuning.
            values = levenberg_marquardt(observation.flat, values, span, 1).values
            whole = _with_tunings(observation, values, span, free)
            if (found := _lowest(observation, values, whole, _DAMPED)) is not None:
                span = whole
        if found is None:  # there is no tuning, or one ran away
            found = _lowest(observation, values, span)
        if found is None:
            raise Unsolvable
        r, J = observation.linearise(found.values)
        # A payload moves nothing where nothing that was found is elastic.
        moving = (J @ span).any(axis=tuple(range(J.ndim - 1)))
        return Fit(
            observation,
            found.values,
            span[:, moving],
            sizes,
            r,
            J,
            bool(found.converged),
            variances,
        )

    def without_causes(self) -> Fit:
        """The user's model alone; where sizes of errors are known, by the variances that it shows."""
        fit = self.fit()
        if not self.model.prior_rows:
            return fit
        return self.fit(values=fit.values, variances=self.with_variances(fit).variances)

    def _under(self, observation: Points, variances: Variances) -> Points:
        """An observation under variances: what is known of sizes weighs as noisy rows do."""
        scatter, prior_weight = self.scatter.at(variances), 1.0
        if variances.any:
            prior_weight = scatter.typical(observation.rows(self.scatter.levers))
        elif observation.model.prior_rows:
            prior_weight = variances.scale
        return replace(observation, scatter=scatter, prior_weight=prior_weight)

    def with_variances(self, fit: Fit) -> Fit:
        """The fit under the variances that its residual shows."""
        rows = fit.observation.rows(self.scatter.levers)
        found = variance_components(self.scatter, rows, fit.linear, self.model.robot, self.arm)
        observation = self._under(fit.observation, found.variances)
        return replace(fit, levels=found, variances=found.variances, observation=observation)

    def outliers(self, fit: Fit) -> tuple[Mask, Array, float]:
        """Poses that a fit does not explain, (m,), the statistic of every pose, (m,), and its limit."""
        every = replace(fit.observation, weights=self.weights)
        r, J = every.linearise(fit.values)
        linear, kept = replace(fit.by_instrument, r=r, J=J), ~self.dropped
        statistic, _ = pose_statistics(linear, kept)
        statistic = statistic / extrapolation_factor(self.data.poses, linear, kept, statistic)
        limit = threshold(statistic, math.prod(self.weights.shape[-3:-1]))
        return judge(statistic, limit), statistic, limit


def _lowest(
    observation: Points, values: Array, span: Array, damping: float = FIRST_DAMPING
) -> Minimum | None:
    """The least squares from values (p,) along a span (p, k); None where no arm has such values."""
    rows = int(observation.data.seen.sum()) * observation.data.readings.shape[-1]
    most = int(np.clip(_WORK / (rows * len(values)), *_ITERATIONS))
    found = levenberg_marquardt(observation.flat, values, span, most, damping)
    parts = observation.linearise(found.values)
    small = np.abs(found.values) <= _ABSURD * observation.model.sizes
    return found if small.all() and all(np.isfinite(part).all() for part in parts) else None


def determined_by(observation: Points, start: Array) -> Array:
    """Directions (p, k) that the data determine, and all coefficients of curves: their prior does."""
    curved = np.zeros(len(start), dtype=bool)
    for _, part in curves_in(observation.model):
        curved[part] = True
    plain = np.eye(len(start))[:, ~curved]
    kept = choose_directions(observation, start, plain).kept
    return np.concatenate([plain[:, kept], np.eye(len(start))[:, curved]], axis=1)


def _with_tunings(observation: Points, values: Array, span: Array, free: IntArray) -> Array:
    """Directions (p, k), and those of the tunings that the amounts make visible."""
    whole = np.concatenate([span, np.eye(len(values))[:, free]], axis=1)
    kept = choose_directions(observation, values, whole).kept
    return np.asarray(whole[:, np.union1d(np.arange(span.shape[1]), kept)])
