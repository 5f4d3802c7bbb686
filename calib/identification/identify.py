"""Identification: from measured points to parameters with honest uncertainties."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from calib.arrays import Array, Mask
from calib.cell import Cell
from calib.effects.base import Base
from calib.effects.tool import Body, Tool
from calib.errors import CalibError, TooFewPoses, Unsolvable
from calib.identification.estimators import Differences, Estimator, Readings, steps, unspent
from calib.identification.identification import Identification, Method, Residuals, Status
from calib.identification.initial import initial_values
from calib.identification.mistakes import refuse_mistakes, refuse_unreachable
from calib.identification.noise_level import NoiseLevel, noise_level, of_levels
from calib.identification.of_type import by_itself, held_by_type
from calib.identification.outliers import pose_statistics, prediction_statistics, threshold
from calib.identification.search import Found, search
from calib.identification.tuning import profiled, with_tunings
from calib.instruments import Tracker
from calib.model import Model
from calib.model.build import build, lacking, refuse_idle_effects
from calib.model.covariance import clustered, covariance, ignorance
from calib.observations import (
    Approach,
    Observation,
    Points,
    Weighting,
    as_poses,
    orientable,
    with_measured_shape,
)
from calib.population import Departure
from calib.poses import Measurements
from calib.poses.moves import before_the_first_move, of_one_clock
from calib.scatter import Levels, Scatter, Variances, levels_of, scatter_of
from calib.solver import levenberg_marquardt
from calib.threads import one_blas_thread
from calib.uncertainty.considered import considered

_NO_UNIT = 1e5  # arm lengths between points, beyond which no wrong unit explains them
_REMEDIES = {
    "time": "add time_s to both tables, hold out a share of one table",
}
_POSES_PER_DIRECTION = 3  # fewer do not tell how poses scatter


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
    weighting, length : of approach pose: "full" propagated covariance, "normalised" by each
        component's own standard deviation, or "plain" with a characteristic length [m]
    differences : elastic parameters from differences between readings at equal joints

    Raises UnknownEffect, EffectCannotAct, TooFewPoses, ImplausibleData, CalibError.
    """
    _check_options(approach, method, weighting, length, differences)
    built = build(cell, data.poses)
    if differences and built.model.prior_rows:
        raise CalibError(
            "differences go without [model.prior], which is of every reading; drop one"
        )
    data = after_the_first_move(built.model, data)
    check_counts(built.model, data)
    refuse_idle_effects(cell, built.model, data.poses)
    estimator: Estimator = Differences() if differences else Readings(method)
    try:
        points, start = _points(cell, built.model, data, approach, differences)
        observation: Observation = (
            points
            if approach == "points"
            else as_poses(points, points.model.marker_positions(start), weighting, length)
        )
        sought = _sought(cell, estimator, observation, start)
    except np.linalg.LinAlgError:
        raise Unsolvable from None
    observation, found, levels = sought.observation, sought.found, sought.levels
    model, values = observation.model, found.best.values
    counted = observation.only(found.kept)
    noise, dof = _noise(estimator, observation, found)
    if observation.mixing is not None and levels is not None:
        noise = of_levels(levels, noise)
    widened = noise.factor if observation.mixing is None else 1.0
    stated = estimator.covariance(counted, values, found.span)
    by_profile = profiled(counted, values, found.span, np.sqrt(np.diag(stated)), widened)
    fit = residuals(model, data, values, ~found.kept, found.statistics, found.limit)
    nominal = _nominal(observation, start)
    parts: dict[str, tuple[Residuals, Mask | None]] = {
        "nominal": (residuals(model, data, nominal), None),
        "fitted": (fit, found.kept),
        "fitted_all": (residuals(model, data, found.first.values), None),
    }
    held = None
    if heldout is not None:
        # Judged as the fitted poses are, by the instrument's noise alone.
        alone = estimator.covariance(replace(counted, scatter=None), values, found.span)
        held = _predicted(cell, observation, heldout, values, alone, found)
        parts |= {"heldout": (held, None), "heldout_trimmed": (held, ~held.outlier)}
    return Identification(
        model=model,
        values=values,
        covariance=stated * widened**2,
        ignorance=ignorance(
            counted.flat(values)[1], found.span, model.sizes, np.diag(stated) <= 0.0
        ),
        status=_status(found),
        approach=approach,
        method=method,
        noise=noise,
        dof=dof,
        rank=found.choice.rank,
        iterations=found.best.iterations,
        unidentifiable=found.choice.unidentifiable,
        absorbed=built.dropped,
        undecided=tuple(data.poses.names[i] for i in np.flatnonzero(found.undecided)),
        unused=_unused(observation),
        fit=fit,
        heldout=held,
        nominal=nominal,
        distances={key: part.lengths(poses) for key, (part, poses) in parts.items()},
        by_instrument=_by_instrument(parts),
        std_by_pose=_std_by_pose(counted, found) if isinstance(estimator, Readings) else None,
        step_two_std=_step_two_std(counted, values, found.span) * widened,
        weights=observation.weights,
        scatter=observation.scatter,
        levels=levels,
        profiled=by_profile,
        footprint=model.footprint(values, data),
        of_type=sought.of_type,
        common=considered(
            model, values, counted.data, partial(estimator.followed, counted, values, found.span)
        ),
    )


def _points(
    cell: Cell, model: Model, data: Measurements, approach: Approach, differences: bool
) -> tuple[Points, Array]:
    """What is fitted, whitened, its tunings found by a scan, and where the search starts (p,)."""
    start = initial_values(model, data)
    refuse_mistakes(model, data, start)
    weights = whitening(cell, model, start, data)
    model, start = with_tunings(Points(model, data, weights), start)
    if approach == "pose":
        start = _with_shape(model, data, start)
    points = Points(model, data, weights)
    if differences:  # what is common to a configuration drops out of them
        return points, start
    return replace(points, known=_known(cell, model, start, data)), start


@dataclass(frozen=True, eq=False)
class _Sought:
    """Where a search ended.

    observation : Observation, under the levels of noise that were found; levels : None for differences
    of_type : Departure, where the cell names the robot's type
    """

    observation: Observation
    found: Found
    levels: Levels | None
    of_type: Departure | None = None


def _sought(cell: Cell, estimator: Estimator, observation: Observation, start: Array) -> _Sought:
    """The estimate, beside the robot's type where the cell names one."""
    of_type = None
    if observation.model.prior_rows:
        observation, found, of_type = _beside_type(cell, estimator, observation, start)
    else:
        found = search(estimator, observation, start)
    if isinstance(estimator, Differences):
        return _Sought(observation, found, None)
    judged, levels = _with_levels(cell, estimator, observation, found)
    return _Sought(judged, found, levels, of_type)


def _beside_type(
    cell: Cell, estimator: Estimator, observation: Observation, start: Array
) -> tuple[Observation, Found, Departure]:
    """The estimate with the robot's type, as far as the readings by themselves are of that type."""
    loose = replace(observation, model=by_itself(observation.model))
    found = search(estimator, loose, start)
    judged, _ = _with_levels(cell, estimator, loose, found)
    noise, _ = _noise(estimator, judged, found)
    counted = judged.only(found.kept)
    cov = estimator.covariance(counted, found.best.values, found.span)
    if judged.mixing is None:
        return held_by_type(estimator, observation, found, cov * noise.factor**2, noise.factor)
    cost, dof = _left(estimator, judged, found)
    return held_by_type(
        estimator, observation, found, cov, max(1.0, float(np.sqrt(cost / max(dof, 1))))
    )


def after_the_first_move(model: Model, data: Measurements) -> Measurements:
    """The data without what was read before the first move, where the model asks whence joints came.

    An approach of zero would say that the gap was in its middle, which it never is.
    """
    if not any("approach" in effect.uses for effect in model.effects):
        return data
    return replace(data, seen=data.seen & ~before_the_first_move(data.poses)[:, None])


def _check_options(
    approach: str, method: str, weighting: str, length: float, differences: bool
) -> None:
    for value, known in (
        (approach, ("points", "pose")),
        (method, ("joint", "two-step")),
        (weighting, ("full", "normalised", "plain")),
    ):
        if value not in known:
            raise CalibError(f"{value!r} is unknown; choose {' or '.join(known)}")
    if not 0.0 < length < np.inf:
        raise CalibError(f"the characteristic length {length} must be a length above zero")
    if differences and (approach != "points" or method != "joint"):
        raise CalibError("differences go with approach points and method joint; drop one of them")


def check_counts(model: Model, data: Measurements) -> None:
    """Refuse what no choice of so few poses could determine.

    A reading of M markers fixes at most 3, 5 or 6 rigid coordinates (M = 1, 2, more), that of a body 6;
    the shape of the set of markers and bodies is common to all readings.

    Raises TooFewPoses with the number that is needed, CalibError for points that no arm of this size
    could have reached.
    """
    if (tracked := model.tracked(data)) is not None:
        refuse_unreachable(*tracked, _NO_UNIT)
    p, coordinates = len(model.parameters), _coordinates(model)
    rigid = {3: 3, 6: 5}.get(coordinates, 6) if len(model.markers) < 3 else 6
    shape = coordinates - rigid if len(model.where(Tool)) else 0
    measured = int(data.seen.any(axis=1).sum())
    placed = sum(
        len(e.parameters) for e in model.effects if isinstance(e, Base) and not e.of.stationed
    )
    numbers = int((data.seen * model.readout.channels.rows).sum())
    known = model.prior_rows
    equations = min(numbers, rigid * measured + shape + placed) + known
    if equations < p:
        raise TooFewPoses(measured, int(np.ceil((p - shape - known) / rigid)), p, equations)


def _coordinates(model: Model) -> int:
    """How many numbers say where the markers and bodies are on the tip."""
    bodies = sum(isinstance(e, Body) for e in model.effects)
    return 3 * (len(model.markers) - 3 * bodies) + 6 * bodies


def whitening(cell: Cell, model: Model, values: Array, data: Measurements) -> Array:
    """Weights of the readings, shape (m, C, r, r); zero for hidden markers.

    A tracker's range is from where the cell says it stands, else from the origin of its readings.
    Raises CalibError where it stands at one place and the data have several stations.
    """
    if len(data.poses.stations) > 1 and any(i.fixed for i in cell.instruments):
        raise CalibError(
            "[instrument] position_mm holds for one station and the data have "
            f"{len(data.poses.stations)}; take it out, and ranges count from each station's origin"
        )
    W = model.readout.whitening(values, data.poses, data.readings, data.sigma)
    return W * data.seen[..., None, None]


def residuals(
    model: Model,
    data: Measurements,
    values: Array,
    outlier: Mask | None = None,
    statistics: Array | None = None,
    limit: float = np.inf,
) -> Residuals:
    """Measured minus predicted readings of a data set.

    values : ndarray, shape (p,), SI; outlier, statistics : ndarray, shape (m,), of the poses
    """
    vectors = model.off(values, data)
    none = np.zeros(len(data), dtype=bool)
    return Residuals(
        model.readout.channels,
        data,
        vectors,
        none if outlier is None else outlier,
        np.zeros(len(data)) if statistics is None else statistics,
        limit,
    )


def _by_instrument(
    parts: dict[str, tuple[Residuals, Mask | None]],
) -> dict[tuple[str, str], dict[str, float]]:
    found: dict[tuple[str, str], dict[str, float]] = {}
    for key, (part, poses) in parts.items():
        for name, unit, errors in part.errors(poses):
            rms = {key: float(np.sqrt(np.mean(errors**2)))} if len(errors) else {}
            found.setdefault((name, unit), {}).update(rms)
    return found


def _status(found: Found) -> Status:
    if not (bool(found.best.converged) and found.regular):
        return "not_converged"
    return "rank_deficient" if found.choice.unidentifiable else "converged"


def _known(cell: Cell, model: Model, values: Array, data: Measurements) -> Scatter:
    """How the readings of an approach err together, as the cell says it."""
    return scatter_of(
        model, values, data.poses, Variances.of_arm(model.robot.dof, cell.repeatability)
    )


def _with_levels(
    cell: Cell, estimator: Estimator, observation: Observation, found: Found
) -> tuple[Observation, Levels]:
    """The observation with how whole poses err together, as the poses kept show it."""
    model, values, known = observation.model, found.best.values, cell.repeatability
    scatter = scatter_of(model, values, observation.data.poses, Variances.none(model.robot.dof))
    counted = observation.only(found.kept)
    judged = estimator.judged(counted, values, found.span)
    off, by_known = model.beside(values)
    levels = levels_of(
        scatter,
        counted.points().rows(scatter.levers),
        judged.r,
        judged.J @ judged.span,
        held=np.column_stack([by_known @ judged.span, off]),
        known=known,
    )
    return replace(observation, scatter=scatter.at(levels.variances)), levels


def _noise(estimator: Estimator, observation: Observation, found: Found) -> tuple[NoiseLevel, int]:
    """Noise level from the kept poses, and the degrees of freedom of their residuals."""
    cost, dof = _left(estimator, observation, found)
    data, weights = observation.data.take(found.kept), observation.weights[found.kept]
    lengths = observation.model.readout.channels.lengths
    return noise_level(cost, dof, data, weights, lengths), dof


def _left(estimator: Estimator, observation: Observation, found: Found) -> tuple[float, int]:
    """What the kept poses leave, in the noise as stated, and its degrees of freedom.

    What is known beside the readings counts as readings do, but for the robot's type: a robot that left
    it is no louder.
    """
    counted, values = observation.only(found.kept), found.best.values
    cost = float((estimator.judged(counted, values, found.span).r ** 2).sum())
    known = observation.model.known_rows - observation.model.prior_rows
    cost += float((observation.model.beside(values)[0][:known] ** 2).sum())
    dof = estimator.dof(counted, found.span) - round(unspent(counted, values, found.span))
    return cost, dof


def _with_shape(model: Model, data: Measurements, start: Array) -> Array:
    """Initial values fit for approach pose. Raises CalibError where no orientation can be had."""
    if not all(type(i) is Tracker for i in model.instruments):
        raise CalibError(
            "approach pose makes poses of the points that a tracker reads of several markers; here "
            "readings are of other kinds, so use approach points"
        )
    if not orientable(model.marker_positions(start), data.seen).any():
        raise CalibError(
            "approach pose needs three visible markers that are not in line; "
            "measure more markers, or use approach points"
        )
    return with_measured_shape(model, data, start) if len(model.where(Tool)) else start


def _unused(observation: Observation) -> tuple[str, ...]:
    """Poses whose markers were measured and do not count."""
    data = observation.data
    idle = data.seen.any(axis=1) & ~observation.weights.any(axis=(1, 2, 3))
    return tuple(data.poses.names[i] for i in np.flatnonzero(idle))


def _nominal(observation: Observation, start: Array) -> Array:
    """Values with base and markers fitted and all else as in the nominal model."""
    model = observation.model
    placement = model.where(Base, Tool)
    nominal = model.initial
    if not len(placement):
        return nominal
    alone, own = model.without([e for e in model.effects if not isinstance(e, Base | Tool)], start)
    points = replace(observation.points(), model=alone)
    nominal[placement] = levenberg_marquardt(points.flat, own, np.eye(len(own))).values
    return nominal


def _std_by_pose(counted: Observation, found: Found) -> Array | None:
    """Standard deviations from the scatter of whole poses, None where they are few."""
    kept = int(found.kept.sum())
    if kept < _POSES_PER_DIRECTION * found.span.shape[1] or not counted.efficient:
        return None
    r, J = replace(counted.points(), known=counted.known).linearise(found.best.values)
    held = counted.beside(found.best.values)[1]
    return np.sqrt(np.diag(clustered(r[found.kept], J[found.kept], found.span, held)))


def _step_two_std(observation: Observation, values: Array, span: Array) -> Array:
    """Standard deviations of the paper's step 2, base and tool taken as known; NaN for those."""
    _, rest = steps(observation.model, span)
    if not rest.shape[1]:
        return np.full(len(values), np.nan)
    _, J = observation.flat(values)
    std = np.sqrt(np.diag(covariance(J, rest)))
    return np.where(std > 0.0, std, np.nan)


def _predicted(
    cell: Cell,
    observation: Observation,
    heldout: Measurements,
    values: Array,
    cov: Array,
    found: Found,
) -> Residuals:
    """Residuals of poses that took no part, judged by the limit of those that did."""
    model, data = observation.model, observation.data
    r, J = observation.points().linearise(values)
    held = observation.beside(values)[1]
    limit = threshold(pose_statistics(r, J, found.kept, found.span, held)[0], r.shape[-1])
    heldout = _with_stations_of(data, heldout)
    _check_covariates(model, data, heldout)
    points = Points(model, heldout, whitening(cell, model, values, heldout))
    statistics, _ = prediction_statistics(*points.linearise(values), cov)
    return residuals(model, heldout, values, statistics > limit, statistics, limit)


def _check_covariates(model: Model, data: Measurements, heldout: Measurements) -> None:
    """Refuse to predict what the held-out poses do not say."""
    missing = lacking(heldout.poses)
    if not of_one_clock(data.poses, heldout.poses):
        missing |= {"time"}
    for effect in model.effects:
        for covariate in effect.uses:
            if covariate in missing:
                raise CalibError(
                    f"held-out poses have no {covariate}, which {effect.kind}:{effect.where} needs; "
                    f"{_REMEDIES.get(covariate, 'add its column to their table')}, or leave these "
                    "poses out"
                )


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
