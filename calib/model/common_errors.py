"""Errors common to all readings as considered parameters (facts of an instrument, not unknowns).

Least-squares values follow common errors b by ``S = N^-1 J' W J_b``, so that their covariance grows
by ``S Sigma_b S'``. Where b acts on the prediction itself, as the direction of gravity does, the point
that is predicted with b of zero errs by ``J S b - J_b b``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from calib.arm.se3 import rotate, so3_exp
from calib.arrays import Array
from calib.instruments import Tracker
from calib.instruments.common_errors import CommonError
from calib.model import Model
from calib.poses import Measurements, Poses

_STEP = 1e-3  # rad, of gravity; its derivative is central


@dataclass(frozen=True, eq=False)
class Considered:
    """A systematic error common to all readings, and the response of the estimate to it.

    instrument : str, whose it is
    response : ndarray, shape (p, b), SI: of the values to one standard uncertainty of each component
    at_reading : float, m, RMS by which one standard uncertainty moves a reading of the fit, in space
    """

    error: CommonError
    instrument: str
    response: Array
    at_reading: float

    @property
    def covariance(self) -> Array:
        """What it adds to the covariance of the values, shape (p, p), SI."""
        return np.asarray(self.response @ self.response.T)

    def at(self, model: Model, values: Array, J: Array, poses: Poses) -> Array:
        """How predictions of points miss by one standard uncertainty, shape (..., 3, b), m.

        J : ndarray, shape (..., 3, p), their derivatives
        """
        missed = J @ self.response
        if self.error.kind.columns is None:
            missed = missed - by_gravity(model, values, poses) * self.error.std
        return np.asarray(missed)


Follow = Callable[[Array], Array]
"""How values (p, b) follow readings that are displaced, (m, C, r, b)."""


def considered(
    model: Model, values: Array, data: Measurements, follow: Follow
) -> tuple[Considered, ...]:
    """Every common error of the model's instruments; data : as fitted."""
    return tuple(
        Considered(
            error,
            instrument.name,
            follow(moved * error.std),
            float(np.sqrt((moved**2)[data.seen].sum(axis=(-1, -2)).mean())) * error.std,
        )
        for instrument, error, moved in common_displacements(model, values, data)
    )


def common_displacements(
    model: Model, values: Array, data: Measurements
) -> Iterator[tuple[Tracker, CommonError, Array]]:
    """How readings follow each error, shape (m, C, r, b), SI."""
    for instrument, part in model.readout.channels.blocks:
        if not isinstance(instrument, Tracker):
            continue
        for error in instrument.common:
            columns = error.kind.columns
            if columns is None:
                own = by_gravity(model, values, data.poses)[:, part]
            else:
                beams = model.readout.beams(instrument, values, data.poses, data.readings[:, part])
                own = columns(beams)
            moved = np.zeros((*data.readings.shape, own.shape[-1]))
            moved[:, part, : own.shape[-2]] = own
            yield instrument, error, moved * data.seen[..., None, None]


def by_gravity(model: Model, values: Array, poses: Poses) -> Array:
    """How predicted readings follow gravity that turns about two level axes, (m, C, r, 2), per rad."""
    across = np.linalg.svd(model.gravity[None])[2][1:]
    turned = [
        [
            replace(model, gravity=rotate(so3_exp(sign * _STEP * axis), model.gravity)).predict(
                values, poses
            )
            for sign in (1.0, -1.0)
        ]
        for axis in across
    ]
    return np.stack([(ahead - back) / (2.0 * _STEP) for ahead, back in turned], axis=-1)
