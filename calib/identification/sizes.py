"""The estimate with the sizes of errors that the cell states, or that the readings show."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib.arrays import Array
from calib.cell import Cell
from calib.identification.checks import outnumbered
from calib.identification.estimators import Estimator
from calib.identification.fit import Estimation, search, weighed_search
from calib.inference.widths import Elementary, SizePrior, Widths, widths_of
from calib.linear import LinearProblem, orthonormal
from calib.model import Model
from calib.observations import Observation
from calib.scatter import VarianceEstimate
from calib.solver import condensed

_ROUNDS = 4  # of widths and fit in turn
_SETTLED = 0.05  # of a width
_LITTLE = 0.01  # of the degrees of freedom of the residuals


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
    fit = weighed_search(estimator, bare, start).with_variances(cell)
    if prior is not None:
        return _with_prior(cell, fit, prior)
    return fit if errors is None else _with_widths(cell, fit, errors)


def _with_prior(
    cell: Cell,
    fit: Estimation,
    prior: SizePrior,
    lost: tuple[int, ...] = (),
    before: VarianceEstimate | None = None,
) -> Estimation:
    """The estimate with a prior of sizes, gone on with from one without, or with others.

    lost : positions of values that stay where they are; before : variances to begin with
    """
    observation = replace(
        fit.observation,
        model=replace(fit.model, prior=prior),
        scatter=None,
        prior_weight=fit.noise_scale,
        lost=lost,
    )
    found = search(fit.estimator, observation, fit.values, fit.kept)
    return replace(found, choice=fit.choice).with_variances(cell, before)


def _with_widths(cell: Cell, alone: Estimation, errors: Elementary) -> Estimation:
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
    for _ in range(_ROUNDS if errors.keys else 0):
        sizes = _widths(fit, errors, known)
        if not sizes.shows:
            return fit
        if fit.sizes is not None and np.allclose(sizes.widths, fit.sizes.widths, rtol=_SETTLED):
            break
        # Where the prior holds much, each round is another fit, and its variances are sought anew.
        before = fit.levels if sizes.saved < _LITTLE * fit.left[1] else None
        fit = replace(_with_prior(cell, fit, sizes.prior, lost, before), sizes=sizes)
    return fit


def _widths(fit: Estimation, of: Elementary, known: Model) -> Widths:
    """How large errors are by the readings of a fit, the noise as it found that.

    known : Model, without sizes: what it knows beside the readings counts as they do
    """
    observation, values = fit.counted, fit.values
    scale = fit.noise.divisor if observation.mixing is None else 1.0
    r, J = (rows / scale for rows in observation.whitened(values))
    prior = known.prior_residuals(values)
    y, J = LinearProblem(r, J, fit.span, *prior, observation.mixing).independent
    used = int(np.count_nonzero(J.any(axis=1)))
    rows = condensed(np.column_stack([J, y + J @ values]))
    Q = orthonormal(np.delete(rows[:, :-1], of.at, axis=1))
    rows = rows[:, [*of.at, -1]]
    left = rows - Q @ (Q.T @ rows)
    return widths_of(of, left[:, :-1], left[:, -1], used - Q.shape[1])
