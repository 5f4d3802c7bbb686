"""The estimate: a fit weighed by the noise that it shows, with variances, and with sizes of errors.

Fit and noise follow from each other. Several instruments are weighed by the noise of their own; then
come the variances of what whole poses err by; what is known of the size of errors is weighed in last,
by how noisy the readings turned out to be.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib.arrays import Array
from calib.cell import Cell
from calib.identification.checks import outnumbered
from calib.identification.components import Estimation, arm_scatter, with_variances
from calib.identification.estimators import Method
from calib.identification.fit import Fit, search
from calib.identification.noise_scales import noise_scales
from calib.inference.widths import Elementary, SizePrior, Widths, widths_of
from calib.linear import LinearProblem, orthonormal
from calib.model import Model
from calib.observations import Observation, Points, points_of
from calib.solver import condensed

_SCALE_ROUNDS = 4  # of fit and noise scales in turn
_ROUNDS = 4  # of widths and fit in turn
_SETTLED = 0.05  # of a width
_LITTLE = 0.01  # of the degrees of freedom of the residuals


def estimated(
    cell: Cell,
    method: Method,
    observation: Observation,
    start: Array,
    errors: Elementary | None = None,
) -> Estimation:
    """The estimate from ``start`` (p,) on, with the sizes of errors that the cell states.

    errors : whose sizes are found from the readings, and hold what those leave open
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
    for _ in range(_SCALE_ROUNDS if several else 0):
        counted = points_of(fit.counted)
        r, J = counted.whitened(fit.values)
        if not (by := noise_scales(counted, arm_scatter(fit), r, J @ fit.span)):
            break
        known = fit.model.noise_scales
        whole = {name: known.get(name, 1.0) * by.get(name, 1.0) for name in {**known, **by}}
        observation = replace(
            observation,
            model=replace(observation.model, noise_scales=whole),
            weights=observation.model.readout.rescaled(observation.weights, by),
        )
        fit = search(method, observation, fit.values, fit.kept)
    return fit


def _held(found: Estimation, prior: SizePrior, lost: tuple[int, ...] = ()) -> Fit:
    """The fit with a prior of sizes, gone on with from an estimate without one, or with others.

    lost : positions of values that stay where they are
    """
    observation = replace(
        found.observation,
        model=replace(found.model, prior=prior),
        scatter=None,
        prior_weight=found.noise_scale,
        lost=lost,
    )
    return search(found.method, observation, found.values, found.kept)


def _with_sizes(cell: Cell, alone: Estimation, errors: Elementary) -> Estimation:
    """The estimate with a prior of the sizes that errors have by the readings themselves.

    Fit and sizes follow from each other. Where the readings leave nothing open, as it is. What such
    poses do not show at all stays where it was, unless there are fewer readings than parameters.
    """
    found, known = alone, alone.model
    lost: tuple[int, ...] = ()
    if alone.choice.unidentifiable and not outnumbered(known, alone.observation.data):
        gone = {name for entry in alone.choice.unidentifiable for name in entry.names}
        lost = tuple(i for i, p in enumerate(known.parameters) if p.id in gone)
        errors = errors.without(lost)
    for _ in range(_ROUNDS if errors.keys else 0):
        sizes = _sizes(found, errors, known)
        if not sizes.shows:
            return found
        if found.sizes and np.allclose(sizes.widths, found.sizes.widths, rtol=_SETTLED):
            break
        # Where the prior holds much, each round is another fit, and its variances are sought anew.
        before = found.levels if sizes.saved < _LITTLE * found.left[1] else None
        fit = _held(found, sizes.prior, lost)
        found = with_variances(cell, fit, alone.choice, before, sizes)
    return found


def _sizes(found: Estimation, of: Elementary, known: Model) -> Widths:
    """How large errors are by the readings of an estimate, the noise as it found that.

    known : Model, without sizes: what it knows beside the readings counts as they do
    """
    observation, values = found.counted, found.values
    scale = found.noise.divisor if observation.mixing is None else 1.0
    r, J = (rows / scale for rows in observation.whitened(values))
    prior = known.prior_residuals(values)
    y, J = LinearProblem(r, J, found.span, *prior, observation.mixing).independent
    used = int(np.count_nonzero(J.any(axis=1)))
    rows = condensed(np.column_stack([J, y + J @ values]))
    Q = orthonormal(np.delete(rows[:, :-1], of.at, axis=1))
    rows = rows[:, [*of.at, -1]]
    left = rows - Q @ (Q.T @ rows)
    return widths_of(of, left[:, :-1], left[:, -1], used - Q.shape[1])
