"""Identification: from measured points to parameters with honest uncertainties."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.build import build, refuse_idle_effects
from calib.cell import Cell
from calib.covariance import Identifiable, covariance
from calib.effects.base import Base
from calib.effects.tool import Tool
from calib.errors import CalibError, TooFewPoses
from calib.identify.estimators import (
    Differences,
    Estimator,
    Mask,
    Readings,
    as_points,
    choose_directions,
    flattened,
    only,
    steps,
)
from calib.identify.identification import Identification, Method, Residuals, Status
from calib.identify.initial import initial_values
from calib.identify.noise_level import noise_level
from calib.identify.outliers import judge, pose_statistics, prediction_statistics, threshold
from calib.identify.solver import Minimum, levenberg_marquardt
from calib.model import Model
from calib.observations import Approach, Points, Pose, Weighting, orientable
from calib.poses import Measurements
from calib.se3 import Array, rotate
from calib.threads import one_blas_thread

_ROUNDS = 12  # times that outliers are judged anew


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
    differences: bool = False,
) -> Identification:
    """Estimate the effects that the cell's model contains.

    heldout : measurements that take no part in the estimate and are predicted with it
    approach : "points" (marker coordinates, the paper's #2) or "pose" (position and orientation from
        the markers of each pose, #1)
    method : "joint" (all parameters at once) or "two-step" (the paper's section III, iterated)
    weighting, length : of approach pose: "full" propagated covariance, or "plain" with a
        characteristic length [m]
    differences : elastic parameters from differences between readings at equal joints

    Raises UnknownEffect, EffectCannotAct, TooFewPoses, CalibError.
    """
    if differences and (approach != "points" or method != "joint"):
        raise CalibError("differences go with approach points and method joint; drop one of them")
    built = build(cell, data.poses)
    model = built.model
    check_counts(model, data)
    refuse_idle_effects(cell, model, data.poses)
    start = initial_values(model, data)
    weights = whitening(cell, model, start, data)
    points = Points(model, data, weights)
    observation = (
        points
        if approach == "points"
        else _as_poses(points, model.marker_positions(start), weighting, length)
    )
    estimator: Estimator = Differences() if differences else Readings(method)
    found = _fit_without_outliers(estimator, observation, start)

    values, kept = found.best.values, found.kept
    counted = only(observation, kept)
    cost = float((estimator.judged(counted, values, found.span).r ** 2).sum())
    dof = estimator.dof(counted, found.span)
    noise = noise_level(cost, dof, data.take(kept), weights[kept])
    stated = estimator.covariance(counted, values, found.span)
    fit = residuals(model, data, values, ~kept, found.statistics, found.limit)
    distances = {
        "nominal": residuals(model, data, _nominal(observation, start)).lengths(),
        "fitted": fit.lengths(kept),
        "fitted_all": residuals(model, data, found.first.values).lengths(),
    }
    held = None
    if heldout is not None:
        held = _predicted(observation, heldout, values, stated, found.limit)
        distances["heldout"] = held.lengths()
        distances["heldout_trimmed"] = held.lengths(~held.outlier)
    return Identification(
        model=model,
        values=values,
        covariance=stated * noise.factor**2,
        status=_status(found),
        approach=approach,
        method=method,
        noise=noise,
        dof=dof,
        rank=found.choice.rank,
        iterations=found.best.iterations,
        unidentifiable=found.choice.unidentifiable,
        absorbed=built.dropped,
        fit=fit,
        heldout=held,
        distances=distances,
        step_two_std=_step_two_std(counted, values, found.span) * noise.factor,
    )


def check_counts(model: Model, data: Measurements) -> None:
    """Refuse what no choice of so few poses could determine.

    A reading of M markers fixes at most 3, 5 or 6 rigid coordinates (M = 1, 2, more); the shape of
    the marker set is common to all readings.

    Raises TooFewPoses with the number that is needed.
    """
    p, markers = len(model.parameters), data.seen.shape[1]
    rigid = {1: 3, 2: 5}.get(markers, 6)
    shape = 3 * markers - rigid if len(model.where(Tool)) else 0
    measured = int(data.seen.any(axis=1).sum())
    equations = min(3 * int(data.seen.sum()), rigid * measured + shape)
    if equations < p:
        raise TooFewPoses(measured, int(np.ceil((p - shape) / rigid)), p, equations)


def whitening(cell: Cell, model: Model, values: Array, data: Measurements) -> Array:
    """Weights of the points, shape (m, M, 3, 3), 1/m; zero for hidden markers.

    The range is from the instrument where the cell says where it stands, else from the origin of
    the readings.
    """
    beams = data.points
    if cell.instrument is not None:
        R, p = model.placement(values, data.poses)
        beams = beams - (rotate(R, cell.instrument) + p)[:, None, :]
    return cell.noise.whitening(beams, data.sigma) * data.seen[..., None, None]


def residuals(
    model: Model,
    data: Measurements,
    values: Array,
    outlier: Mask | None = None,
    statistics: Array | None = None,
    limit: float = np.inf,
) -> Residuals:
    """Measured minus predicted points of a data set."""
    vectors = (data.points - model.predict(values, data.poses)) * data.seen[..., None]
    none = np.zeros(len(data), dtype=bool)
    return Residuals(
        data,
        vectors,
        none if outlier is None else outlier,
        np.zeros(len(data)) if statistics is None else statistics,
        limit,
    )


@dataclass(frozen=True, eq=False)
class _Found:
    """Where the search for values and outliers ended."""

    first: Minimum
    best: Minimum
    kept: Mask
    statistics: Array
    limit: float
    span: Array
    choice: Identifiable


def _fit_without_outliers(estimator: Estimator, observation: Points | Pose, start: Array) -> _Found:
    """Fit, judge, and fit again without the outliers until the judgement stands."""
    choice = choose_directions(observation, start)
    span = observation.span()[:, choice.kept]
    kept = np.ones(len(observation.data), dtype=bool)
    first = best = estimator.fit(observation, start, span)
    for _ in range(_ROUNDS):
        judged = estimator.judged(observation, best.values, span)
        statistics = pose_statistics(judged.r, judged.J, kept, judged.span)
        limit = threshold(statistics, judged.r.shape[-1])
        fresh = ~judge(statistics, limit)
        if np.array_equal(fresh, kept):
            break
        kept = fresh
        best = estimator.fit(only(observation, kept), best.values, span)
    return _Found(first, best, kept, statistics, limit, span, choice)


def _status(found: _Found) -> Status:
    if not bool(found.best.converged):
        return "not_converged"
    return "rank_deficient" if found.choice.unidentifiable else "converged"


def _as_poses(points: Points, shape: Array, weighting: Weighting, length: float) -> Pose:
    if not orientable(shape, points.data.seen).any():
        raise CalibError(
            "approach pose needs three visible markers that are not in line; "
            "measure more markers, or use approach points"
        )
    return Pose(points.model, points.data, points.weights, shape, weighting, length)


def _nominal(observation: Points | Pose, start: Array) -> Array:
    """Values with base and markers fitted and all else as in the nominal model."""
    model = observation.model
    placement = model.where(Base, Tool)
    nominal = np.zeros_like(start)
    nominal[placement] = start[placement]
    directions = np.eye(len(start))[:, placement]
    return levenberg_marquardt(flattened(as_points(observation)), nominal, directions).values


def _step_two_std(observation: Points | Pose, values: Array, span: Array) -> Array:
    """Standard deviations of the paper's step 2, base and tool taken as known; NaN for those."""
    _, rest = steps(observation.model, span)
    if not rest.shape[1]:
        return np.full(len(values), np.nan)
    _, J = flattened(observation)(values)
    std = np.sqrt(np.diag(covariance(J, rest)))
    return np.where(std > 0.0, std, np.nan)


def _predicted(
    observation: Points | Pose, heldout: Measurements, values: Array, cov: Array, limit: float
) -> Residuals:
    """Residuals of poses that took no part, judged by the limit of those that did."""
    heldout = _with_stations_of(observation.data, heldout)
    typical = np.median(observation.weights[observation.data.seen], axis=0)
    points = Points(observation.model, heldout, typical * heldout.seen[..., None, None])
    r, J = points.linearise(values)
    statistics = prediction_statistics(r, J, cov)
    return residuals(observation.model, heldout, values, statistics > limit, statistics, limit)


def _with_stations_of(data: Measurements, heldout: Measurements) -> Measurements:
    """The same poses with their stations numbered as in the data that were fitted."""
    known, own = data.poses.stations, heldout.poses.stations
    for name in own:
        if name not in known:
            raise CalibError(
                f"held-out poses were measured from station {name!r}, which no fitted pose uses; "
                "its place is unknown, so leave these poses out"
            )
    number = np.array([known.index(name) for name in own])
    poses = replace(heldout.poses, station=number[heldout.poses.station], stations=known)
    return replace(heldout, poses=poses)
