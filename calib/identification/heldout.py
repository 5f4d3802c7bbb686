"""Poses that took no part in an estimate, predicted with it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib.cell import Cell
from calib.errors import CalibError, NoEquilibrium
from calib.identification.fitted import Fitted
from calib.identification.identification import Residuals
from calib.identification.outliers import pose_statistics, prediction_statistics, threshold
from calib.identification.whitening import whitening
from calib.model import Model
from calib.model.build import lacking
from calib.observations import Points, points_of
from calib.poses import Measurements
from calib.poses.moves import of_one_clock

_REMEDIES = {"time": "add time_s to both tables, hold out a share of one table"}


def predicted(cell: Cell, fit: Fitted, heldout: Measurements) -> Residuals:
    """Residuals of poses that took no part, judged as those that did: by the instrument's noise alone.

    Raises CalibError where they do not say what the model asks, or stood at a station of their own.
    """
    model, values, observation = fit.model, fit.values, fit.observation
    r, J = points_of(observation).linearise(values)
    held = observation.beside(values)[1]
    limit = threshold(pose_statistics(r, J, fit.found.kept, fit.span, held)[0], r.shape[-1])
    heldout = with_stations_of(observation.data, heldout)
    _check_covariates(model, observation.data, heldout)
    points = Points(model, heldout, whitening(cell, model, values, heldout))
    cov = fit.estimator.covariance(replace(fit.counted, scatter=None), values, fit.span)
    r, J = points.linearise(values)
    if not np.isfinite(r).all():
        raise NoEquilibrium(" at the held-out poses")
    statistics, _ = prediction_statistics(r, J, cov)
    return Residuals.of(model, heldout, values, statistics > limit, statistics, limit)


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


def with_stations_of(data: Measurements, heldout: Measurements) -> Measurements:
    """Held-out poses with their stations numbered as in the data that are fitted.

    Raises CalibError for a station that no fitted pose uses.
    """
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
