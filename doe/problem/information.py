"""What a pose tells: whitened rows and information blocks of many configurations.

Where the cell knows the arm's repeatability, all readings of one visit share what the approach was off
by: the rows are those of ``V^-1/2 J`` with ``V = I + H U H^T``, H the tip's levers. Visits stay
independent, so information adds up over them as before.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.api import readings
from calib.arrays import Array, Mask
from calib.cell import Cell
from calib.model import Model
from calib.poses import Poses, poses_at
from calib.scatter import Scatter, Variances, scatter_of
from calib.simulation import whitening


@dataclass(frozen=True, eq=False)
class Regressor:
    """Linearisation of a cell's model before anything is known, in the coordinates of the criteria.

    values : ndarray, shape (p,), SI, where it is linearised
    T : ndarray, shape (p, p), ``theta = T y``
    silent : whether readings free of load carry nothing, and are left out
    """

    cell: Cell
    model: Model
    values: Array
    T: Array
    silent: bool = False

    @property
    def rank(self) -> int:
        """Rows that one configuration brings, or the number of parameters if that is less."""
        readings_each = 1 if self.silent or self.cell.load is None else 2
        numbers = int(self.model.readout.channels.rows.sum())
        return int(min(numbers * readings_each, self.T.shape[1]))

    def rows(self, q: Array, visible: Mask | None = None) -> Array:
        """Independent rows of all readings of each visit, in standard deviations, (m, rows, p).

        q : ndarray, shape (m, dof), a visit each; visible : ndarray, shape (m, M), markers in sight,
            all without it
        """
        poses = readings(self.cell, poses_at(q, names=[""] * len(q)))
        # What carries nothing of the model still tells what the approach was off by.
        first = len(q) if self.silent else 0
        if not self.cell.scatters:
            poses, first = poses.take(slice(first, None)), 0
        # A model of its own: the last linearisation that a model remembers is no use to others.
        model = replace(self.model)
        points, J = model.jacobian(self.values, poses)
        seen = None if visible is None else _tiled(visible, poses, q)
        rows = self._whitened(model, poses, points, seen, J)
        if self.cell.scatters:
            scatter = self.scatter(model, poses, len(q))
            levers = self._whitened(model, poses, points, seen, scatter.levers)
            rows = scatter.mixing(levers)(rows)
        p = J.shape[-1]
        rows = (rows[first:].reshape(-1, p) @ self.T).reshape(len(poses) - first, -1, p)
        stacked = rows.reshape(-1, len(q), *rows.shape[1:])
        return np.concatenate(list(stacked), axis=1)

    def levers(self, q: Array, visible: Mask) -> Array:
        """How a visit's readings follow the tip, in the instrument's standard deviations, (m, rows, 6).

        q : ndarray, shape (m, dof); visible : ndarray of bool, shape (m, M)
        """
        poses = readings(self.cell, poses_at(q, names=[""] * len(q)))
        model = replace(self.model)
        points = model.predict(self.values, poses)
        tip = self.scatter(model, poses, len(q)).levers[..., -6:]
        rows = self._whitened(model, poses, points, _tiled(visible, poses, q), tip)
        return np.concatenate(list(rows.reshape(-1, len(q), *rows.shape[1:])), axis=1)

    def scatter(self, model: Model, poses: Poses, visits: int) -> Scatter:
        """How the readings of so many visits err together; poses : in the order of ``readings``."""
        known = Variances.of_arm(model.robot.dof, self.cell.repeatability)
        visit = np.arange(len(poses)) % visits
        found = scatter_of(model, self.values, poses, known)
        return replace(found, approach=visit, configuration=visit)

    def _whitened(
        self, model: Model, poses: Poses, points: Array, seen: Mask | None, J: Array
    ) -> Array:
        """Columns (m, C, r, k) in the instrument's standard deviations, shape (m, r C, k)."""
        even = model.readout.even
        # One number does for every row of most trackers: no matrices then.
        J = whitening(model, self.values, poses, points) @ J if even is None else J / even
        if seen is not None:
            J = J * seen[:, :, None, None]
        return np.asarray(J.reshape(len(poses), -1, J.shape[-1]))

    def information(self, q: Array, visible: Mask | None = None) -> Array:
        """Information matrix of each configuration, shape (m, p, p)."""
        rows = self.rows(q, visible)
        return np.swapaxes(rows, -1, -2) @ rows

    def whitened(self, mean: Array) -> Regressor:
        """The same in coordinates in which ``mean`` (p, p), in the present ones, is the identity."""
        L = np.linalg.cholesky(mean)
        return replace(self, T=self.T @ np.linalg.inv(L).T)


def _tiled(visible: Mask, poses: Poses, q: Array) -> Mask:
    return np.tile(visible, (len(poses) // len(q), 1))
