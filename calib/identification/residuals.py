"""Measured minus predicted readings: of what was fitted, and of poses that took no part."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from calib.arrays import Array, Mask
from calib.cell import Cell
from calib.errors import CalibError, NoEquilibrium
from calib.identification.fit import Fit
from calib.identification.outliers import fit_statistics, pose_statistics, threshold
from calib.identification.start import whitening
from calib.instruments import Channels, Instrument
from calib.model import Model
from calib.model.build import lacking
from calib.observations import Points, points_of
from calib.poses import Measurements
from calib.poses.moves import of_one_clock


@dataclass(frozen=True, eq=False)
class Residuals:
    """Measured minus predicted readings.

    vectors : ndarray, shape (m, C, r), of a tracker m, zero where hidden
    outlier : ndarray of bool, shape (m,)
    statistic : ndarray, shape (m,), what outliers are judged by; limit : float
    """

    channels: Channels
    data: Measurements
    vectors: Array
    outlier: Mask
    statistic: Array
    limit: float

    @classmethod
    def of(
        cls,
        model: Model,
        data: Measurements,
        values: Array,
        outlier: Mask | None = None,
        statistic: Array | None = None,
        limit: float = np.inf,
    ) -> Residuals:
        """Those of a data set under values (p,), SI; no pose is an outlier unless it is said."""
        outlier = np.zeros(len(data), dtype=bool) if outlier is None else outlier
        statistic = np.zeros(len(data)) if statistic is None else statistic
        channels, vectors = model.readout.channels, model.off(values, data)
        return cls(channels, data, vectors, outlier, statistic, limit)

    def lengths(self, poses: Mask | None = None) -> Array:
        """Lengths (n,), m, of the visible residuals that have one, of the poses (m,) or of all."""
        measured = self.channels.lengths
        distance = np.linalg.norm(np.where(measured, self.vectors, 0.0), axis=-1)
        return np.asarray(distance[self._seen(poses) & measured.any(axis=-1)])

    def errors(self, poses: Mask | None = None) -> Iterator[tuple[str, str, Array]]:
        """Instrument, unit and lengths (n,) of its visible errors in that unit, of the same poses."""
        for instrument, part in self.channels.blocks:
            seen = self._seen(poses)[:, part]
            units = dict.fromkeys(number.unit for number in instrument.numbers)
            off = {unit: self._off(instrument, part, unit) for unit in units}
            for name in instrument.names:
                here = seen & self.data.poses.touching(name, instrument.sites)[:, None]
                yield from ((name, unit, off[unit][here]) for unit in units)

    def _seen(self, poses: Mask | None) -> Mask:
        return self.data.seen if poses is None else self.data.seen & poses[:, None]

    def _off(self, instrument: Instrument, part: slice, unit: str) -> Array:
        """By how much an instrument's readings are off as people read them, (m, c), in the unit."""
        measured = self.data.readings[:, part, : instrument.rows]
        shown = instrument.shown(measured, self.vectors[:, part, : instrument.rows])
        at = [i for i, number in enumerate(instrument.numbers) if number.unit == unit]
        return np.asarray(np.linalg.norm(shown[..., at], axis=-1)) / instrument.numbers[at[0]].scale


# -- poses that took no part -----------------------------------------------------------------------


def predicted(cell: Cell, fit: Fit, heldout: Measurements) -> Residuals:
    """Residuals of poses that took no part, judged as those that did: by the instrument's noise alone.

    Raises CalibError where they do not say what the model asks, or stood at a station of their own.
    """
    model, values, data = fit.model, fit.values, fit.observation.data
    fitted = replace(points_of(fit.observation), scatter=None)
    rows = math.prod(fitted.weights.shape[-3:-1])
    limit = threshold(pose_statistics(fitted.linear(values, fit.span), fit.kept)[0], rows)
    heldout = with_stations_of(data, heldout)
    _check_covariates(model, data, heldout)
    r, J = Points(model, heldout, whitening(cell, model, values, heldout)).linearise(values)
    if not np.isfinite(r).all():
        raise NoEquilibrium(" at the held-out poses")
    none = np.zeros(len(r), dtype=bool)
    cov = replace(fit.counted, scatter=None).covariance(values, fit.span)
    statistics, _ = fit_statistics(r, J, none, cov)
    return Residuals.of(model, heldout, values, statistics > limit, statistics, limit)


def _check_covariates(model: Model, data: Measurements, heldout: Measurements) -> None:
    """Refuse to predict what the held-out poses do not say."""
    missing = lacking(heldout.poses)
    if not of_one_clock(data.poses, heldout.poses):
        missing |= {"time"}
    for effect in model.effects:
        for covariate in effect.uses:
            if covariate in missing:
                remedy = "add its column to their table"
                if covariate == "time":
                    remedy = "add time_s to both tables, hold out a share of one table"
                raise CalibError(
                    f"held-out poses have no {covariate}, which {effect.kind}:{effect.where} needs; "
                    f"{remedy}, or leave these poses out"
                )


def with_stations_of(data: Measurements, heldout: Measurements) -> Measurements:
    """Held-out poses with their stations numbered as in the data that are fitted.

    Raises CalibError for a station that no fitted pose uses.
    """
    known, stations = data.poses.stations, heldout.poses.stations
    for name in stations:
        if name not in known:
            raise CalibError(
                f"held-out poses were measured from station {name!r}, which no fitted pose uses; "
                "its place is unknown, so leave these poses out"
            )
    number = np.array([known.index(name) for name in stations])
    poses = replace(heldout.poses, station=number[heldout.poses.station], stations=known)
    return replace(heldout, poses=poses)
