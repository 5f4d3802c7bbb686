"""The estimate itself: values, outliers, and how loud the readings and the arm are."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib.arm.repeatability import usual_repeatability
from calib.arrays import Array
from calib.cell import Cell
from calib.identification.checks import outnumbered
from calib.identification.estimators import Differences, Estimator, unspent
from calib.identification.noise_level import NoiseLevel, noise_level, of_levels
from calib.identification.of_type import by_itself, held_by_type
from calib.identification.search import Found, search
from calib.identification.sizes import widths_by
from calib.model import Model
from calib.model.covariance import Identifiable
from calib.observations import Observation, points_of
from calib.population import Departure
from calib.population.prior import Prior
from calib.population.sizes import Elementary, Widths
from calib.scatter import Levels, Scatter, Unnoticed, Variances, levels_of, scatter_of, unnoticed
from calib.scatter.search import problem_of

_MOST_ROUNDS = 4  # of widths and fit in turn
_SETTLED = 0.05  # of a width


@dataclass(frozen=True, eq=False)
class Fitted:
    """An estimate and what it was made of.

    observation : Observation, under the levels of noise that were found; found : where its search ended
    levels : Levels, how whole poses err together; None for differences, where that drops out
    of_type : Departure, where the cell names the robot's type
    sizes : Widths, of errors, where they hold what the readings leave open; told : Identifiable, what
        the readings determine without them
    """

    estimator: Estimator
    observation: Observation
    found: Found
    levels: Levels | None = None
    of_type: Departure | None = None
    sizes: Widths | None = None
    told: Identifiable | None = None

    @property
    def model(self) -> Model:
        """As it was fitted."""
        return self.observation.model

    @property
    def values(self) -> Array:
        """The estimate, shape (p,), SI."""
        return self.found.best.values

    @property
    def span(self) -> Array:
        """Directions that were estimated, shape (p, k)."""
        return self.found.span

    @cached_property
    def counted(self) -> Observation:
        """Of the poses that were kept."""
        return self.observation.only(self.found.kept)

    @property
    def choice(self) -> Identifiable:
        """What the readings determine."""
        return self.found.choice if self.told is None else self.told

    def covariance(self) -> Array:
        """Covariance of the values for the noise as stated, shape (p, p), SI."""
        return self.estimator.covariance(self.counted, self.values, self.span)

    @cached_property
    def left(self) -> tuple[float, int]:
        """What the kept poses leave, in the noise as stated, and its degrees of freedom.

        What is known beside the readings counts as readings do, but for the robot's type: a robot that
        left it is no louder.
        """
        judged = self.estimator.judged(self.counted, self.values, self.span)
        known = self.model.known_rows - self.model.prior_rows
        beside = self.model.beside(self.values)[0][:known]
        unused = round(unspent(self.counted, self.values, self.span))
        cost = float((judged.r**2).sum()) + float((beside**2).sum())
        return cost, self.estimator.dof(self.counted, self.span) - unused

    @cached_property
    def noise(self) -> NoiseLevel:
        """How loud the readings are, by the poses that were kept."""
        kept, observation = self.found.kept, self.observation
        data, weights = observation.data.take(kept), observation.weights[kept]
        alone = noise_level(*self.left, data, weights, self.model.readout.channels.lengths)
        if observation.mixing is None or self.levels is None:
            return alone
        return of_levels(self.levels, alone)

    @property
    def widening(self) -> float:
        """Actual over stated deviations of the values; one where the levels hold what the arm adds."""
        return self.noise.factor if self.observation.mixing is None else 1.0

    @property
    def loudness(self) -> float:
        """Actual over believed noise of the rows that the estimate is made of."""
        if self.observation.mixing is None:
            return self.noise.factor
        r, _ = self.counted.linearise(self.values)
        spent = int(self.counted.numbers.sum()) - self.left[1]
        dof = int(np.count_nonzero(r)) - spent
        return max(1.0, float(np.sqrt((r**2).sum() / max(dof, 1))))


def fitted(
    cell: Cell,
    estimator: Estimator,
    observation: Observation,
    start: Array,
    errors: Elementary | None = None,
) -> Fitted:
    """The estimate from ``start`` (p,) on, beside the robot's type where the cell names one.

    errors : whose sizes are found from the readings, and hold what those leave open
    """
    prior = observation.model.own_prior
    if prior is not None and prior.robots:
        fit = _beside_type(cell, estimator, observation, start)
    else:
        bare = replace(observation, model=replace(observation.model, prior=None))
        fit = _judged(cell, Fitted(estimator, bare, search(estimator, bare, start)))
        if prior is not None:
            return _beside(cell, fit, prior)
    return fit if errors is None else _beside_sizes(cell, fit, errors)


def _beside(cell: Cell, fit: Fitted, prior: Prior, lost: tuple[int, ...] = ()) -> Fitted:
    """The estimate with a prior of sizes, gone on with from one without, or with others.

    lost : positions of values that stay where they are
    """
    observation = replace(
        fit.observation,
        model=replace(fit.model, prior=prior),
        scatter=None,
        pull=fit.loudness,
        lost=lost,
    )
    found = search(fit.estimator, observation, fit.values, fit.found.kept)
    return _judged(cell, replace(fit, observation=observation, found=found, told=fit.choice))


def _beside_sizes(cell: Cell, alone: Fitted, errors: Elementary) -> Fitted:
    """The estimate with a prior of the sizes that errors have by the readings themselves.

    Fit and widths follow from each other. Where the readings leave nothing open, as it is. What such
    poses do not show at all stays where it was, unless there are fewer readings than parameters.
    """
    fit, known, told = alone, alone.model, alone.found.choice
    lost: tuple[int, ...] = ()
    if told.unidentifiable and not outnumbered(known, alone.observation.data):
        gone = {name for entry in told.unidentifiable for name in entry.names}
        lost = tuple(i for i, p in enumerate(known.parameters) if p.id in gone)
        errors = errors.without(lost)
    if not errors.keys:
        return alone
    for _ in range(_MOST_ROUNDS):
        sizes = widths_by(fit, errors, known)
        if not sizes.shows:
            return fit
        if fit.sizes is not None and np.allclose(sizes.widths, fit.sizes.widths, rtol=_SETTLED):
            break
        prior = sizes.prior if known.prior is None else known.prior.beside(sizes.prior)
        fit = replace(_beside(cell, fit, prior, lost), sizes=sizes)
    return fit


def _beside_type(
    cell: Cell, estimator: Estimator, observation: Observation, start: Array
) -> Fitted:
    """The estimate with the robot's type, as far as the readings by themselves are of that type."""
    loose = replace(observation, model=by_itself(observation.model))
    alone = _judged(cell, Fitted(estimator, loose, search(estimator, loose, start)))
    cov, pull = alone.covariance() * alone.widening**2, alone.loudness
    beside, found, of_type = held_by_type(estimator, observation, alone.found, cov, pull)
    return replace(_judged(cell, Fitted(estimator, beside, found)), of_type=of_type)


def _judged(cell: Cell, fit: Fitted) -> Fitted:
    """The same with how whole poses err together, as the poses kept show it."""
    if isinstance(fit.estimator, Differences):
        return fit
    linear = _linear(fit)
    levels = levels_of(*linear, known=cell.repeatability)
    observation = replace(fit.observation, scatter=linear[0].at(levels.variances))
    return replace(fit, observation=observation, levels=levels)


def _linear(fit: Fitted) -> tuple[Scatter, Array, Array, Array, Array]:
    """The linear problem of a fit, as :func:`calib.scatter.levels_of` takes it."""
    model, values, poses = fit.model, fit.values, fit.observation.data.poses
    scatter = scatter_of(model, values, poses, Variances.none(model.robot.dof))
    judged = fit.estimator.judged(fit.counted, values, fit.span)
    off, by_known = model.beside(values)
    held = np.column_stack([by_known @ judged.span, off])
    levers = points_of(fit.counted).rows(scatter.levers)
    return scatter, levers, judged.r, judged.J @ judged.span, held


def by_unnoticed(cell: Cell, fit: Fitted) -> tuple[Array, Unnoticed] | None:
    """Covariance (p, p) that scatter adds which was not found, and that scatter.

    None where scatter was found or is stated, and where the residual has widened everything already.
    """
    levels, noise = fit.levels, fit.noise
    known = cell.repeatability is not None or levels is None or levels.variances.any
    if known or noise.source == "residual":
        return None
    linear = _linear(fit)
    problem, *_ = problem_of(*linear)
    usual = usual_repeatability(fit.model.robot.reach)
    found = unnoticed(linear[0], problem, usual, noise.divisor)
    if found is None:
        return None
    counted = replace(fit.counted, scatter=linear[0].at(found.variances))
    whole = fit.estimator.covariance(counted, fit.values, fit.span)
    return whole - fit.covariance() * fit.widening**2, found
