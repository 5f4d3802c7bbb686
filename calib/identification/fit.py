"""The fit of a model to readings: its values, the poses that do not belong, and the levels of noise.

A fit judges every pose, and what it rejects stays out of the next, until the judgement stands. What is
known of the size of errors is weighed in afterwards, by how noisy the readings turned out to be.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib.arrays import Array, Mask
from calib.cell import Cell
from calib.identification.checks import outnumbered
from calib.identification.components import ArmVariances, variance_components
from calib.identification.estimators import (
    Estimator,
    choose_directions,
    elastic_directions,
)
from calib.identification.noise_level import NoiseLevel, noise_level, of_levels
from calib.identification.noise_scales import noise_scales
from calib.identification.outliers import (
    extrapolation_factor,
    independent_share,
    judge,
    next_outlier,
    pose_statistics,
    small_set,
    threshold,
    wrongly_out,
)
from calib.identification.start import strayed
from calib.linear import LinearProblem, orthonormal
from calib.model import Model
from calib.model.covariance import Identifiable, Unidentifiable
from calib.observations import Observation, Points, points_of
from calib.prior import Elementary, Prior, Widths, widths_of
from calib.scatter import Scatter, Undetected, Variances, scatter_of
from calib.solver import Minimum, condensed

# Of a fit that gross errors bend only the size of what it leaves is told: five digits of it.
_TOLD = 30
_ROUNDS = 12  # times that outliers are judged anew
_STRAYED = "these poses tell so little of it that its estimate ran away"
_WIDTH_ROUNDS = 4  # of widths and fit in turn
_SETTLED = 0.05  # of a width
_SCALE_ROUNDS = 4  # of fit and noise scales in turn


@dataclass(frozen=True, eq=False)
class Estimation:
    """An estimate with its observation, span, outliers and levels of noise.

    observation : Observation, under the levels of noise that were found
    first : Minimum over every pose; best : Minimum over the poses kept
    kept : ndarray of bool, shape (m,); statistics : ndarray, shape (m,), under the last fit, judged by
        ``limit``
    unsettled : ndarray of bool, shape (m,), poses of which the last fit says other than was fitted
    choice : Identifiable, what the readings determine; span : ndarray, shape (p, k), the directions
        that were estimated: more of them where the sizes of errors hold what the readings leave open
    regular : whether the kept poses still determine them where the search ended
    levels : ArmVariances or None, how whole poses err together
    sizes : Widths, of errors, where they hold what the readings leave open
    """

    estimator: Estimator
    observation: Observation
    first: Minimum
    best: Minimum
    kept: Mask
    statistics: Array
    limit: float
    unsettled: Mask
    choice: Identifiable
    span: Array
    regular: bool
    levels: ArmVariances | None = None
    sizes: Widths | None = None

    @property
    def model(self) -> Model:
        """As it was fitted."""
        return self.observation.model

    @property
    def values(self) -> Array:
        """The estimate, shape (p,), SI."""
        return self.best.values

    @cached_property
    def counted(self) -> Observation:
        """The observation of the poses that were kept."""
        return self.observation.only(self.kept)

    @cached_property
    def stated_covariance(self) -> Array:
        """Covariance of the values for the noise as stated, shape (p, p), SI."""
        return self.estimator.covariance(self.counted, self.values, self.span)

    @cached_property
    def left(self) -> tuple[float, int]:
        """What the kept poses leave, in the noise as stated, and its degrees of freedom.

        What is known beside the readings counts as readings do, but for the sizes of errors.
        """
        judged = self.estimator.judged(self.counted, self.values, self.span)
        known = self.model.known_rows - self.model.prior_rows
        prior = self.model.prior_residuals(self.values)[0][:known]
        cost = float((judged.r**2).sum()) + float((prior**2).sum())
        return cost, self.estimator.dof_of_readings(self.counted, self.values, self.span)

    @cached_property
    def noise(self) -> NoiseLevel:
        """Noise scale of the readings, from the poses that were kept."""
        data, weights = self.observation.data.take(self.kept), self.observation.weights[self.kept]
        alone = noise_level(*self.left, data, weights, self.model.readout)
        if self.observation.mixing is None or self.levels is None:
            return alone
        return of_levels(self.levels, alone)

    @property
    def widening(self) -> float:
        """Actual over stated deviations of the values; one where the levels hold what the arm adds."""
        return self.noise.factor if self.observation.mixing is None else 1.0

    @property
    def noise_scale(self) -> float:
        """Actual over believed noise of the rows that the estimate is made of."""
        if self.observation.mixing is None:
            return self.noise.factor
        r, _ = self.counted.linearise(self.values)
        spent = int(self.counted.numbers.sum()) - self.left[1]
        dof = int(np.count_nonzero(r)) - spent
        return max(1.0, float(np.sqrt((r**2).sum() / max(dof, 1))))

    @cached_property
    def _problem(self) -> tuple[Scatter, Array, LinearProblem]:
        """How its poses may err together, as :func:`calib.scatter.levels_of` takes it."""
        model, values, poses = self.model, self.values, self.observation.data.poses
        scatter = scatter_of(model, values, poses, Variances.none(model.robot.dof))
        levers = points_of(self.counted).rows(scatter.levers)
        return scatter, levers, self.estimator.judged(self.counted, values, self.span)

    def under_levels(self, cell: Cell, before: ArmVariances | None = None) -> Estimation:
        """The same with how whole poses err together, as the poses kept show it."""
        problem = self._problem
        levels = variance_components(*problem, self.model.robot, cell.repeatability, before)
        observation = replace(self.observation, scatter=problem[0].at(levels.variances))
        return replace(self, observation=observation, levels=levels)

    @property
    def by_undetected(self) -> tuple[Array, Undetected] | None:
        """Covariance (p, p) that scatter adds which does not show, and that scatter.

        None where scatter shows or is stated, and where the residual has widened everything.
        """
        found = None if self.levels is None else self.levels.undetected
        if found is None or self.noise.source == "residual":
            return None
        found = replace(found, variances=replace(found.variances, scale=self.noise.divisor))
        counted = replace(self.counted, scatter=self._problem[0].at(found.variances))
        whole = self.estimator.covariance(counted, self.values, self.span)
        return whole - self.stated_covariance * self.widening**2, found


# -- outliers ----------------------------------------------------------------------------------


def search(
    estimator: Estimator, observation: Observation, start: Array, kept: Mask | None = None
) -> Estimation:
    """Fit without the outliers, each round judged by the fit before.

    kept : ndarray of bool, shape (m,), poses that an earlier search kept: this one goes on from there

    With something elastic in the model, gross outliers are first looked for under the rigid part
    alone: a bent arm can follow a wrong point a long way. What only bent is taken back after.
    """
    choice = _Choice.at(observation, start)
    if kept is None:
        kept = _stiffly_kept(estimator, observation, start, choice.span)
    best, choice = _fit(estimator, observation.only(kept), start, start, choice)
    first = best if kept.all() else None
    judged = _judged(estimator, observation, best.values, kept, choice.span)
    for _ in range(_ROUNDS):
        if np.array_equal(judged.kept, kept):
            break
        kept = judged.kept
        counted = observation.only(kept)
        best, choice = _fit(estimator, counted, start, best.values, _Choice.at(counted, start))
        judged = _judged(estimator, observation, best.values, kept, choice.span)
    if first is None:
        first = estimator.fit(observation, best.values, choice.span, _TOLD)
    counted, regular = observation.only(kept), False
    for _ in range(_ROUNDS):
        at_end = choice.anew(counted, best.values)
        regular = at_end.span.shape[1] >= choice.span.shape[1]
        if regular:
            break
        # The start was where more is told: a marker on an axis tells less than one beside it.
        best, choice = _fit(estimator, counted, start, start, at_end)
        judged = _judged(estimator, observation, best.values, kept, choice.span)
    return Estimation(
        estimator,
        observation,
        first,
        best,
        kept,
        judged.statistics,
        judged.limit,
        judged.kept != kept,
        choice.told,
        choice.span,
        regular,
    )


def search_with_noise_scales(
    estimator: Estimator, observation: Observation, start: Array
) -> Estimation:
    """The search with each of several instruments weighed by the noise of its own readings.

    start : ndarray, shape (p,), SI; raises as :func:`search` does
    """
    found = search(estimator, observation, start)
    if not isinstance(observation, Points):
        return found
    for _ in range(_SCALE_ROUNDS):
        if not (by := _scales_left(found)):
            break
        known = found.model.noise_scales
        whole = {name: known.get(name, 1.0) * by.get(name, 1.0) for name in {**known, **by}}
        observation = replace(
            observation,
            model=replace(observation.model, noise_scales=whole),
            weights=observation.model.readout.rescaled(observation.weights, by),
        )
        found = search(estimator, observation, found.values, found.kept)
    return found


def _scales_left(found: Estimation) -> Mapping[str, float]:
    """Actual over assumed noise of several instruments after a fit; empty where it is as assumed."""
    counted = points_of(found.counted)
    none = Variances.none(found.model.robot.dof)
    scatter = scatter_of(found.model, found.values, counted.data.poses, none)
    r, J = counted.whitened(found.values)
    return noise_scales(counted, scatter, r, J @ found.span)


@dataclass(frozen=True, eq=False)
class _Choice:
    """What is estimated.

    among : ndarray, shape (p, n), directions to choose from; chosen : Identifiable, of them
    strayed : tuple of Unidentifiable, that are not among them, for a fit lost them
    """

    among: Array
    chosen: Identifiable
    strayed: tuple[Unidentifiable, ...] = ()

    @classmethod
    def at(cls, observation: Observation, values: Array) -> _Choice:
        """What the data determine at some values."""
        among = observation.span()
        return cls(among, choose_directions(observation, values, among))

    def anew(self, observation: Observation, values: Array) -> _Choice:
        """The choice made anew, linearised at other values."""
        return replace(self, chosen=choose_directions(observation, values, self.among))

    def without(self, observation: Observation, values: Array, strayed: Mask) -> _Choice:
        """The choice without values (p,) whose estimates diverged."""
        names = tuple(observation.model.parameters[i].id for i in np.flatnonzero(strayed))
        among = self.among[:, np.abs(self.among[strayed]).sum(axis=0) == 0.0]
        lost = Unidentifiable(names, _STRAYED)
        return replace(self, among=among, strayed=(*self.strayed, lost)).anew(observation, values)

    @property
    def span(self) -> Array:
        return self.among[:, self.chosen.kept]

    @property
    def told(self) -> Identifiable:
        return replace(self.chosen, unidentifiable=(*self.chosen.unidentifiable, *self.strayed))


def _fit(
    estimator: Estimator, observation: Observation, start: Array, begun: Array, choice: _Choice
) -> tuple[Minimum, _Choice]:
    """The fit from ``begun`` (p,), and what it estimates: what strays from ``start`` stays there."""

    def lost(values: Array) -> Mask:
        return strayed(observation.model, observation.data, start, values)

    best = estimator.fit(observation, begun, choice.span)
    while (out := lost(best.values)).any():
        choice = choice.without(observation, start, out)
        best = estimator.fit(observation, start, choice.span, _TOLD)
        if not lost(best.values).any():
            best = estimator.fit(observation, best.values, choice.span)
    return best, choice


@dataclass(frozen=True, eq=False)
class _Judgement:
    """Poses to keep, the statistic of every pose, both (m,), and its limit."""

    kept: Mask
    statistics: Array
    limit: float


def _stiffly_kept(
    estimator: Estimator, observation: Observation, start: Array, span: Array
) -> Mask:
    """Poses to keep by a fit in which nothing yields, all where nothing can."""
    every = np.ones(len(observation.data), dtype=bool)
    rigid = span[:, ~elastic_directions(observation.model, span)]
    if not 0 < rigid.shape[1] < span.shape[1]:
        return every
    stiff = estimator.fit(observation, start, rigid)
    return _judged(estimator, observation, stiff.values, every, rigid).kept


def _judged(
    estimator: Estimator, observation: Observation, values: Array, kept: Mask, span: Array
) -> _Judgement:
    """What the fit to the poses kept says of every pose."""
    judged = estimator.judged(observation, values, span, kept)
    statistics, rows = pose_statistics(judged, kept)
    statistics = statistics / extrapolation_factor(observation.data.poses, judged, kept, statistics)
    if not small_set(len(kept)):
        limit = threshold(statistics, math.prod(observation.weights.shape[-3:-1]))
        return _Judgement(~judge(statistics, limit), statistics, limit)
    cost = float((judged.r[kept] ** 2).sum())
    dof = estimator.dof_of_readings(observation.only(kept), values, span)
    each = observation.data.in_place(judged.r).reshape(len(kept), -1)
    tested = statistics, rows, kept, cost, dof, independent_share(each, kept)
    fresh = kept.copy()
    if (back := wrongly_out(*tested)) is not None:
        fresh[back] = True
    elif (worst := next_outlier(*tested)) is not None:
        fresh[worst] = False
    return _Judgement(fresh, statistics, float(statistics[fresh].max(initial=0.0)))


# -- what is known beforehand ------------------------------------------------------------------


def fitted(
    cell: Cell,
    estimator: Estimator,
    observation: Observation,
    start: Array,
    errors: Elementary | None = None,
) -> Estimation:
    """The estimate from ``start`` (p,) on, with the sizes of errors that the cell states.

    errors : whose sizes are found from the readings, and hold what those leave open
    """
    prior = observation.model.own_prior
    bare = replace(observation, model=replace(observation.model, prior=None))
    fit = search_with_noise_scales(estimator, bare, start).under_levels(cell)
    if prior is not None:
        return _with_prior(cell, fit, prior)
    return fit if errors is None else _with_size_prior(cell, fit, errors)


def _with_prior(
    cell: Cell, fit: Estimation, prior: Prior, lost: tuple[int, ...] = ()
) -> Estimation:
    """The estimate with a prior of sizes, gone on with from one without, or with others.

    lost : positions of values that stay where they are
    """
    observation = replace(
        fit.observation,
        model=replace(fit.model, prior=prior),
        scatter=None,
        prior_weight=fit.noise_scale,
        lost=lost,
    )
    found = search(fit.estimator, observation, fit.values, fit.kept)
    return replace(found, choice=fit.choice).under_levels(cell, fit.levels if fit.sizes else None)


def _with_size_prior(cell: Cell, alone: Estimation, errors: Elementary) -> Estimation:
    """The estimate with a prior of the sizes that errors have by the readings themselves.

    Fit and widths follow from each other. Where the readings leave nothing open, as it is. What such
    poses do not show at all stays where it was, unless there are fewer readings than parameters.
    """
    fit, known = alone, alone.model
    lost: tuple[int, ...] = ()
    if alone.choice.unidentifiable and not outnumbered(known, alone.observation.data):
        gone = {name for entry in alone.choice.unidentifiable for name in entry.names}
        lost = tuple(i for i, p in enumerate(known.parameters) if p.id in gone)
        errors = errors.without(lost)
    if not errors.keys:
        return alone
    for _ in range(_WIDTH_ROUNDS):
        sizes = _widths(fit, errors, known)
        if not sizes.shows:
            return fit
        if fit.sizes is not None and np.allclose(sizes.widths, fit.sizes.widths, rtol=_SETTLED):
            break
        fit = replace(_with_prior(cell, fit, sizes.prior, lost), sizes=sizes)
    return fit


def _widths(fit: Estimation, of: Elementary, known: Model) -> Widths:
    """How large errors are by the readings of a fit, the noise as it found that.

    known : Model, without sizes: what it knows beside the readings counts as they do
    """
    observation, values = fit.counted, fit.values
    scale = fit.noise.divisor if observation.mixing is None else 1.0
    r, J = observation.whitened(values)
    if scale != 1.0:
        r, J = r / scale, J / scale
    prior = known.prior_residuals(values)
    y, J = LinearProblem(r, J, fit.span, *prior, observation.mixing).independent
    used = int(np.count_nonzero(J.any(axis=1)))
    rows = condensed(np.column_stack([J, y + J @ values]))
    J, y = rows[:, :-1], rows[:, -1]
    Q = orthonormal(np.delete(J, of.at, axis=1))
    own = J[:, of.at]
    return widths_of(of, own - Q @ (Q.T @ own), y - Q @ (Q.T @ y), used - Q.shape[1])
