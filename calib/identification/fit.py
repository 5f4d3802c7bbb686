"""The fit of a model to readings: its values, the poses that do not belong, and the variances.

A fit judges every pose, and what it rejects stays out of the next, until the judgement stands. What is
known of the size of errors is weighed in afterwards, by how noisy the readings turned out to be
(:mod:`calib.identification.sizes`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib.arrays import Array, Mask
from calib.cell import Cell
from calib.identification.components import variance_components
from calib.identification.estimators import Directions, Estimator, elastic_directions
from calib.identification.noise_level import NoiseLevel, noise_level, of_levels
from calib.identification.noise_scales import noise_scales
from calib.identification.outliers import Judgement, judged
from calib.identification.start import strayed
from calib.inference.widths import Widths
from calib.linear import LinearProblem
from calib.model import Model
from calib.model.covariance import Identifiable
from calib.observations import Observation, Points, points_of
from calib.scatter import Scatter, Undetected, VarianceEstimate, Variances, scatter_of
from calib.solver import Minimum

# Of a fit that gross errors bend only the size of what it leaves is stated: five digits of it.
_FEW_DIGITS = 30
_ROUNDS = 12  # times that outliers are judged anew
_SCALE_ROUNDS = 4  # of fit and noise scales in turn


@dataclass(frozen=True, eq=False)
class Estimation:
    """An estimate with its observation, span, outliers and variances.

    observation : Observation, under the variances that were found
    first : Minimum over every pose; best : Minimum over the poses kept
    kept : ndarray of bool, shape (m,); statistics : ndarray, shape (m,), under the last fit, judged by
        ``limit``
    unsettled : ndarray of bool, shape (m,), poses of which the last fit says other than was fitted
    choice : Identifiable, what the readings determine; span : ndarray, shape (p, k), the directions
        that were estimated: more of them where the sizes of errors hold what the readings leave open
    regular : whether the kept poses still determine them where the search ended
    levels : VarianceEstimate or None, how whole poses err together
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
    levels: VarianceEstimate | None = None
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
        return self.counted.covariance(self.values, self.span)

    @cached_property
    def _judged(self) -> LinearProblem:
        """The kept readings about the values, as if nothing but the instrument erred."""
        return self.estimator.judged(self.counted, self.values, self.span)

    @cached_property
    def left(self) -> tuple[float, int]:
        """What the kept poses leave, in the noise as stated, and its degrees of freedom.

        What is known beside the readings counts as readings do, but for the sizes of errors.
        """
        known = self.model.known_rows - self.model.prior_rows
        prior = self.model.prior_residuals(self.values)[0][:known]
        cost = float((self._judged.r**2).sum()) + float((prior**2).sum())
        return cost, self.estimator.freedom(self.counted, self.values, self.span)

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
    def arm_scatter(self) -> Scatter:
        """How its poses may err together, of no size yet."""
        none = Variances.none(self.model.robot.dof)
        return scatter_of(self.model, self.values, self.observation.data.poses, none)

    def with_variances(self, cell: Cell, before: VarianceEstimate | None = None) -> Estimation:
        """The same with how whole poses err together, as the poses kept show it."""
        scatter, levers = self.arm_scatter, points_of(self.counted).rows(self.arm_scatter.levers)
        known, robot = cell.repeatability, self.model.robot
        levels = variance_components(scatter, levers, self._judged, robot, known, before)
        observation = replace(self.observation, scatter=scatter.at(levels.variances))
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
        counted = replace(self.counted, scatter=self.arm_scatter.at(found.variances))
        whole = counted.covariance(self.values, self.span)
        return whole - self.stated_covariance * self.widening**2, found


def weighed_search(estimator: Estimator, observation: Observation, start: Array) -> Estimation:
    """The search with each of several instruments weighed by the noise of its own readings.

    start : ndarray, shape (p,), SI; raises as :func:`search` does
    """
    found = search(estimator, observation, start)
    for _ in range(_SCALE_ROUNDS if isinstance(observation, Points) else 0):
        counted = points_of(found.counted)
        r, J = counted.whitened(found.values)
        if not (by := noise_scales(counted, found.arm_scatter, r, J @ found.span)):
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


def search(
    estimator: Estimator, observation: Observation, start: Array, kept: Mask | None = None
) -> Estimation:
    """Fit without the outliers, each round judged by the fit before.

    kept : ndarray of bool, shape (m,), poses that an earlier search kept: this one goes on from there

    With something elastic in the model, gross outliers are first looked for under the rigid part
    alone: a bent arm can follow a wrong point a long way. What only bent is taken back after.
    """
    own = _Search(estimator, observation, start)
    choice = Directions.at(observation, start)
    if kept is None:
        kept = own.rigidly_kept(choice.span)
    best, choice = own.fit(kept, start, choice)
    first = best if kept.all() else None
    said = own.judged(best.values, kept, choice.span)
    for _ in range(_ROUNDS):
        if np.array_equal(said.kept, kept):
            break
        kept = said.kept
        best, choice = own.fit(kept, best.values, Directions.at(observation.only(kept), start))
        said = own.judged(best.values, kept, choice.span)
    if first is None:
        first = estimator.fit(observation, best.values, choice.span, _FEW_DIGITS)
    regular = False
    for _ in range(_ROUNDS):
        at_end = choice.anew(observation.only(kept), best.values)
        regular = at_end.span.shape[1] >= choice.span.shape[1]
        if regular:
            break
        # The start was where more is told: a marker on an axis tells less than one beside it.
        best, choice = own.fit(kept, start, at_end)
        said = own.judged(best.values, kept, choice.span)
    return Estimation(
        estimator,
        observation,
        first,
        best,
        kept,
        said.statistics,
        said.limit,
        said.kept != kept,
        choice.identifiable,
        choice.span,
        regular,
    )


@dataclass(frozen=True, eq=False)
class _Search:
    """What all fits of a search share; start : ndarray, shape (p,), SI."""

    estimator: Estimator
    observation: Observation
    start: Array

    def fit(self, kept: Mask, begun: Array, choice: Directions) -> tuple[Minimum, Directions]:
        """The fit from ``begun`` (p,), and what it estimates: what diverges stays at the start."""
        counted, estimator = self.observation.only(kept), self.estimator

        def lost(values: Array) -> Mask:
            return strayed(counted.model, counted.data, self.start, values)

        best = estimator.fit(counted, begun, choice.span)
        while (out := lost(best.values)).any():
            choice = choice.without(counted, self.start, out)
            best = estimator.fit(counted, self.start, choice.span, _FEW_DIGITS)
            if not lost(best.values).any():
                best = estimator.fit(counted, best.values, choice.span)
        return best, choice

    def rigidly_kept(self, span: Array) -> Mask:
        """Poses to keep by a fit in which nothing yields, all where nothing can."""
        every = np.ones(len(self.observation.data), dtype=bool)
        rigid = span[:, ~elastic_directions(self.observation.model, span)]
        if not 0 < rigid.shape[1] < span.shape[1]:
            return every
        stiff = self.estimator.fit(self.observation, self.start, rigid)
        return self.judged(stiff.values, every, rigid).kept

    def judged(self, values: Array, kept: Mask, span: Array) -> Judgement:
        """What the fit to the poses kept says of every pose."""
        observation = self.observation
        linear = self.estimator.judged(observation, values, span, kept)
        rows = math.prod(observation.weights.shape[-3:-1])

        def dof() -> int:
            return self.estimator.freedom(observation.only(kept), values, span)

        return judged(observation.data, linear, kept, rows, dof)
