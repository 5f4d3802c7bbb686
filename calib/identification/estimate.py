"""The estimate: a fit weighed by the noise that it shows, with variances, and with sizes of errors.

Several instruments are weighed by the noise of their own; then come the variance components; what is
known of the size of errors is weighed in last, by how noisy the readings turned out to be.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib.arrays import Array
from calib.cell import Cell
from calib.identification.checks import outnumbered
from calib.identification.fit import Fit, Method, of_poses, search
from calib.identification.noise import NoiseLevel, noise_level, noise_scales, of_levels
from calib.identification.variances import VarianceEstimate, variance_components
from calib.inference.widths import Elementary, SizePrior, Widths, widths_of
from calib.model import Model
from calib.model.covariance import Identifiable
from calib.observations import Observation, Points, points_of
from calib.observations.linear import LinearProblem, orthonormal
from calib.observations.scatter import Scatter, Variances, scatter_of
from calib.result import fields_of
from calib.solver import condensed

_ROUNDS = 4  # of fit and noise scales, or of fit and widths, in turn
_SETTLED = 0.05  # of a width
_LITTLE = 0.01  # of the degrees of freedom of the residuals


@dataclass(frozen=True, eq=False)
class Estimation(Fit):
    """A fit with its variances; its observation is that under them.

    levels : VarianceEstimate, how whole poses err together
    sizes : Widths of errors, where they hold what the readings leave open
    """

    levels: VarianceEstimate
    sizes: Widths | None = None

    @cached_property
    def noise(self) -> NoiseLevel:
        """Noise scale of the readings, from the poses that were kept."""
        data, weights = self.observation.data.take(self.kept), self.observation.weights[self.kept]
        alone = noise_level(*self.left, data, weights, self.model.readout)
        return alone if self.observation.mixing is None else of_levels(self.levels, alone)

    @property
    def noise_scale(self) -> float:
        """Actual over believed noise of the rows that the estimate is made of."""
        if self.observation.mixing is None:
            return self.noise.factor
        r, _ = self.counted.linearise(self.values)
        spent = int(self.counted.numbers.sum()) - self.left[1]
        dof = int(np.count_nonzero(r)) - spent
        return max(1.0, float(np.sqrt((r**2).sum() / max(dof, 1))))


def estimated(
    cell: Cell,
    method: Method,
    observation: Observation,
    start: Array,
    errors: Elementary | None = None,
) -> Estimation:
    """The estimate from ``start`` (p,) on, with the sizes of errors that the cell states.

    errors : whose sizes are estimated from the readings, and hold what those leave open
    """
    prior = observation.model.own_prior
    bare = replace(observation, model=replace(observation.model, prior=None))
    alone = with_variances(cell, _by_instruments(method, bare, start))
    if prior is not None:
        return with_variances(cell, _held(alone, prior), alone.choice)
    return alone if errors is None else _with_sizes(cell, alone, errors)


def _by_instruments(method: Method, observation: Observation, start: Array) -> Fit:
    """The fit with each of several instruments weighed by the noise of its own readings."""
    fit = search(method, observation, start)
    several = isinstance(observation, Points) and len(fit.model.instruments) > 1
    for _ in range(_ROUNDS if several else 0):
        counted = points_of(fit.counted)
        r, J = counted.whitened(fit.values)
        if not (scales := noise_scales(counted, arm_scatter(fit), r, J @ fit.span)):
            break
        known = fit.model.noise_scales
        whole = {n: known.get(n, 1.0) * scales.get(n, 1.0) for n in {**known, **scales}}
        weights = observation.model.readout.rescaled(observation.weights, scales)
        model = replace(observation.model, noise_scales=whole)
        observation = replace(observation, model=model, weights=weights)
        fit = search(method, observation, fit.values, fit.kept)
    return fit


def with_variances(
    cell: Cell,
    fit: Fit,
    choice: Identifiable | None = None,
    before: VarianceEstimate | None = None,
    sizes: Widths | None = None,
) -> Estimation:
    """The estimate of a fit, with the variances that its kept poses show.

    choice : what the readings determine without sizes; before : variances to begin with
    """
    scatter, robot = arm_scatter(fit), fit.model.robot
    levers, readings = points_of(fit.counted).rows(scatter.levers), of_poses(fit.readings, fit.kept)
    levels = variance_components(scatter, levers, readings, robot, cell.repeatability, before)
    under = replace(fit.observation, scatter=scatter.at(levels.variances))
    directions = replace(fit.directions, choice=choice or fit.choice)
    fields = fields_of(fit) | {"observation": under, "directions": directions}
    return Estimation(**fields, levels=levels, sizes=sizes)


def arm_scatter(fit: Fit) -> Scatter:
    """How the poses of a fit may err together, of no size yet."""
    none = Variances.none(fit.model.robot.dof)
    return scatter_of(fit.model, fit.values, fit.observation.data.poses, none)


def _held(alone: Estimation, prior: SizePrior, lost: tuple[int, ...] = ()) -> Fit:
    """The fit with a prior of sizes; values at the positions ``lost`` stay where they are."""
    model, weight = replace(alone.model, prior=prior), alone.noise_scale
    observation = replace(
        alone.observation, model=model, scatter=None, prior_weight=weight, lost=lost
    )
    return search(alone.method, observation, alone.values, alone.kept)


def _with_sizes(cell: Cell, alone: Estimation, errors: Elementary) -> Estimation:
    """The estimate with a prior of the sizes that errors have by the readings themselves.

    Fit and sizes follow from each other. Where the readings leave nothing open, as it is. What such
    poses do not show at all stays where it was, unless there are fewer readings than parameters.
    """
    result, known = alone, alone.model
    lost: tuple[int, ...] = ()
    if alone.choice.unidentifiable and not outnumbered(known, alone.observation.data):
        names = {name for entry in alone.choice.unidentifiable for name in entry.names}
        lost = tuple(i for i, p in enumerate(known.parameters) if p.id in names)
        errors = errors.without(lost)
    for _ in range(_ROUNDS if errors.keys else 0):
        sizes = _sizes(result, errors, known)
        if not sizes.shows:
            return result
        if result.sizes and np.allclose(sizes.widths, result.sizes.widths, rtol=_SETTLED):
            break
        # Where the prior holds much, each round is another fit, and its variances are sought anew.
        before = result.levels if sizes.saved < _LITTLE * result.left[1] else None
        result = with_variances(cell, _held(result, sizes.prior, lost), alone.choice, before, sizes)
    return result


def _sizes(result: Estimation, of: Elementary, known: Model) -> Widths:
    """How large errors are by the readings of an estimate, at its noise.

    known : Model, without sizes: what it knows beside the readings counts as they do
    """
    observation, values = result.counted, result.values
    scale = result.noise.divisor if observation.mixing is None else 1.0
    r, J = (rows / scale for rows in observation.whitened(values))
    prior = known.prior_residuals(values)
    y, J = LinearProblem(r, J, result.span, *prior, observation.mixing).independent
    used = int(np.count_nonzero(J.any(axis=1)))
    rows = condensed(np.column_stack([J, y + J @ values]))
    Q = orthonormal(np.delete(rows[:, :-1], of.at, axis=1))
    rows = rows[:, [*of.at, -1]]
    left = rows - Q @ (Q.T @ rows)
    return widths_of(of, left[:, :-1], left[:, -1], used - Q.shape[1])
