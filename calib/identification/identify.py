"""Identification: from measured points to parameters with honest uncertainties."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib.arrays import Array, Mask
from calib.cell import Cell
from calib.effects.tool_base import Base, Tool
from calib.errors import Unsolvable
from calib.identification.checks import check_counts, check_options, check_orientable
from calib.identification.estimate import Estimation, estimated
from calib.identification.fit import Method
from calib.identification.identification import Identification
from calib.identification.mistakes import refuse_mistakes
from calib.identification.residuals import Residuals, predicted
from calib.identification.start import initial_values, whitening
from calib.identification.tuning import with_tunings
from calib.identification.variances import Undetected
from calib.model import Model
from calib.model.build import build, refuse_idle_effects
from calib.model.covariance import ignorance
from calib.model.sizes import elementary
from calib.observations import (
    Approach,
    Observation,
    Points,
    Weighting,
    as_poses,
    points_of,
    with_measured_shape,
)
from calib.observations.scatter import Variances, scatter_of
from calib.poses import Measurements, Poses
from calib.poses.moves import before_the_first_move
from calib.result import fields_of
from calib.solver import levenberg_marquardt
from calib.threads import one_blas_thread

_SHARE = 0.5  # of the errors that the readings determine where their sizes hold the others


@one_blas_thread
def identify(
    cell: Cell,
    data: Measurements,
    *,
    heldout: Measurements | None = None,
    approach: Approach = "points",
    method: Method = "joint",
    weighting: Weighting = "full",
    length: float = 1.0,
) -> Identification:
    """Estimate the effects that the cell's model contains.

    heldout : measurements that take no part in the estimate and are predicted with it
    approach : "points" (marker coordinates, the paper's #2) or "pose" (position and orientation from
        the markers of each pose, #1)
    method : "joint" (all parameters at once) or "two-step" (the paper's section III, iterated)
    weighting, length : of approach pose: "full" propagated covariance, "normalised" by each
        component's own standard deviation, or "plain" with a characteristic length [m]

    Raises UnknownEffect, EffectCannotAct, TooFewPoses, ImplausibleData, CalibError.
    """
    built = build(cell, data.poses)
    model, data = built.model, after_the_first_move(built.model, data)
    with_sizes = cell.size_prior == "estimated"
    check_options(length, approach=approach, method=method, weighting=weighting)
    check_counts(model, data, _SHARE if with_sizes else 1.0)
    refuse_idle_effects(cell, model, data.poses)
    try:
        start = initial_values(model, data)
        weights = whitening(cell, model, start, data)
        refuse_mistakes(model, data, start)
        points, start = with_tunings(Points(model, data, weights), start)
        arm = Variances.of_arm(model.robot.dof, cell.repeatability)
        observation: Observation = points
        if approach == "pose":
            check_orientable(model, data, start)
            if len(model.where(Tool)):
                start = with_measured_shape(points.model, data, start)
            shape = points.model.marker_positions(start)
            observation = as_poses(points, shape, weighting, length)
        known = scatter_of(points.model, start, data.poses, arm)
        errors = elementary(model, built.full) if with_sizes else None
        estimate = estimated(cell, method, replace(observation, known=known), start, errors)
    except np.linalg.LinAlgError:
        raise Unsolvable from None
    own, (covariance, undetected) = _covariance(estimate)
    J, lost = estimate.counted.flat(estimate.values)[1], np.diag(own) <= 0.0
    judgement = ~estimate.kept, estimate.judgement.statistics, estimate.judgement.limit
    return Identification(
        **fields_of(estimate),
        cell=cell,
        covariance=covariance,
        ignorance=ignorance(J, estimate.span, estimate.model.sizes, lost),
        undetected=undetected,
        approach=approach,
        absorbed=built.dropped,
        fit=Residuals.of(estimate.model, data, estimate.values, *judgement),
        heldout=None if heldout is None else predicted(cell, estimate, heldout),
        nominal=_nominal(estimate.observation, start),
    )


def uncounted(model: Model, poses: Poses) -> Mask:
    """Readings (m,) before the first move, where the model asks whence joints came.

    An approach of zero would say that the gap was in its middle, which it never is.
    """
    if not any("approach" in effect.uses for effect in model.effects):
        return np.zeros(len(poses), dtype=bool)
    return before_the_first_move(poses)


def after_the_first_move(model: Model, data: Measurements) -> Measurements:
    """The data without readings before the first move, where approaches count."""
    return replace(data, seen=data.seen & ~uncounted(model, data.poses)[:, None])


def _covariance(
    estimate: Estimation,
) -> tuple[Array, tuple[Array, tuple[Array, Undetected] | None]]:
    """Covariance (p, p), SI, in the noise of the observation; the same as it is stated, and of that
    the part of scatter that does not show, with that scatter.

    Variance components hold what the arm adds; without, the residual widens all alike. There is no such
    part where scatter shows or is stated, and where the residual has widened everything.
    """
    counted, values, span = estimate.counted, estimate.values, estimate.span
    own, hidden = counted.covariance(values, span), estimate.levels.undetected
    widened = own if counted.mixing is not None else own * estimate.noise.factor**2
    if hidden is None or estimate.noise.source == "residual":
        return own, (widened, None)
    hidden = replace(hidden, variances=replace(hidden.variances, scale=estimate.noise.divisor))
    scatter = estimate.observation.scatter
    whole = replace(counted, scatter=scatter and scatter.at(hidden.variances))
    added = whole.covariance(values, span) - widened
    return own, (widened + added, (added, hidden))


def _nominal(observation: Observation, start: Array) -> Array:
    """Values with base and markers fitted and all else as in the nominal model."""
    model = observation.model
    placement, nominal = model.where(Base, Tool), model.initial
    if len(placement):
        others = [e for e in model.effects if not isinstance(e, Base | Tool)]
        alone, own = model.without(others, start)
        points = replace(points_of(observation), model=alone)
        nominal[placement] = levenberg_marquardt(points.flat, own, np.eye(len(own))).values
    return nominal
