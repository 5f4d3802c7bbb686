"""What readings in hand or still to come tell, under the levels of noise that the data show."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.api import readings
from calib.arrays import Array, Mask
from calib.cell import Cell
from calib.identification.identify import whitening
from calib.model import Model
from calib.observations import Points
from calib.poses import Measurements, poses_at
from calib.scatter import Variances, scatter_of
from calib.scatter.poses import Mixing
from doe.sufficiency.forecast import Told, root


@dataclass(frozen=True, eq=False)
class Rows:
    """Rows (m, R, p) of readings, per plausible size, and what makes them independent."""

    rows: Array
    mixing: Mixing | None

    @property
    def independent(self) -> Array:
        """Rows of unit variance, (m, R, p): each less what those before it at equal joints tell."""
        return self.rows if self.mixing is None else self.mixing(self.rows)

    def at(self, chosen: Mask) -> Told:
        """What some of the readings tell together."""
        own = self.rows * chosen[:, None, None]
        core = None if self.mixing is None else self.mixing.covariance(own)
        return Told(root(own.reshape(-1, own.shape[-1])), core)


@dataclass(frozen=True, eq=False)
class Sight:
    """Where all is linearised, and the noise of the readings.

    arm : Variances, of whole poses; factor : float, actual over stated noise of the instrument
    """

    cell: Cell
    model: Model
    values: Array
    arm: Variances
    factor: float

    def weights(self, data: Measurements) -> Array:
        """Whitening matrices of the readings, the noise as stated, shape (m, C, r, r)."""
        return whitening(self.cell, self.model, self.values, data)

    def of(self, data: Measurements, kept: Mask | None = None) -> Rows:
        """The rows of readings, of which some count; points to come stand where they are expected."""
        weights = self.weights(data)
        if kept is not None:
            weights = weights * kept[:, None, None, None]
        scatter = scatter_of(self.model, self.values, data.poses, self.arm)
        points = Points(self.model, data, weights, scatter=scatter)
        _, J = points.linearise(self.values)
        rows = J * self.model.sizes
        if points.mixing is None:
            return Rows(rows / self.factor, None)
        return Rows(rows, points.mixing)

    def foreseen(self, q: Array, visible: Mask) -> Measurements:
        """Readings of fresh poses (k, n), with the markers (k, M) that will be in sight."""
        poses = readings(self.cell, poses_at(q, names=[""] * len(q)))
        seen = np.tile(visible, (len(poses) // len(q), 1))
        points = self.model.predict(self.values, poses)
        return Measurements(poses, points, seen, np.full(seen.shape, np.nan))
