"""How the positions at target poses follow the parameters, and errors common to all readings."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from calib.arrays import Array
from calib.model import Model
from calib.model.common_errors import by_gravity
from calib.model.covariance import at_points_read, at_tip, working_points
from calib.poses import Poses
from doe.problem.linearisation import errors_of


@dataclass(frozen=True, eq=False)
class TargetErrors:
    """Position errors at K target poses to first order, the mean over the points in the rows.

    rows : ndarray, shape (K, r, p), m per unit of the parameters
    weights : ndarray, shape (K,), summing to one
    shifts : ndarray, shape (K, r, b), m, how predictions follow one standard uncertainty of each error
        that is common to all readings
    """

    rows: Array
    weights: Array
    shifts: Array

    @classmethod
    def of(
        cls,
        model: Model,
        values: Array,
        targets: Poses,
        weights: Array,
        at_markers: bool | None = None,
    ) -> Self:
        """Per SI unit about values (p,), for the readings of a model.

        at_markers : whether errors count at the markers, else at the tip's origin; None: where the
            markers are unknowns
        """
        points = working_points if at_markers is None else at_points_read if at_markers else at_tip
        counts = points(model)
        # A model of its own: the last linearisation that a model remembers is no use to others.
        _, J = replace(counts).jacobian_at_rest(values, targets)
        rows = J.reshape(len(targets), -1, J.shape[-1]) / np.sqrt(J.shape[1])
        shifts = _shifts(model, counts, values, targets)
        return cls(np.asarray(rows), weights / weights.sum(), shifts)

    def per(self, T: Array) -> TargetErrors:
        """The same for parameters y with ``theta = T y``, shape (p, p), or (p,) for its diagonal."""
        return replace(self, rows=self.rows * T if T.ndim == 1 else self.rows @ T)

    def missed(self, response: Array) -> Array:
        """What common errors cause that shift the estimate by ``response`` (p, b), (K, r, b), m."""
        return np.asarray(self.rows @ response - self.shifts)


def _shifts(model: Model, counts: Model, values: Array, targets: Poses) -> Array:
    """How predictions at targets follow common errors themselves, (K, r, b), m.

    model : that readings are of; counts : Model, with the points at which errors count
    """
    shape = counts.predict(values, targets).shape
    found = [np.zeros((*shape, 0))]
    for error in errors_of(model):
        columns = error.kind.columns
        if columns is None:
            found.append(by_gravity(counts, values, targets) * error.std)
        else:
            found.append(np.zeros((*shape, columns(np.ones((1, 3))).shape[-1])))
    moved = np.concatenate(found, axis=-1)
    K, points, r = shape
    return np.asarray(moved.reshape(K, points * r, moved.shape[-1]) / np.sqrt(points))
