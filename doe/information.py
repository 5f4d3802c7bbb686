"""What a pose tells: whitened rows and information blocks of many configurations."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.api import readings
from calib.cell import Cell
from calib.model import Model
from calib.poses import Poses, poses_at
from calib.se3 import Array
from calib.simulate import beams


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
        return int(min(3 * len(self.cell.markers) * readings_each, self.T.shape[1]))

    def rows(self, q: Array, visible: NDArray[np.bool_] | None = None) -> Array:
        """Rows of all readings at each configuration, in standard deviations, (m, rows, p).

        q : ndarray, shape (m, dof); visible : ndarray, shape (m, M), markers in sight, all without it
        """
        poses = readings(self.cell, poses_at(q, names=[""] * len(q)))
        if self.silent:
            poses = poses.take(slice(len(q), None))
        both = self._weighted(poses, None if visible is None else _tiled(visible, poses, q))
        stacked = both.reshape(len(poses) // len(q), len(q), -1, both.shape[-1])
        return np.concatenate(list(stacked), axis=1)

    def _weighted(self, poses: Poses, visible: NDArray[np.bool_] | None) -> Array:
        # A model of its own: the last linearisation that a model remembers is no use to others.
        model = replace(self.model)
        points, J = model.jacobian(self.values, poses)
        noise = self.cell.noise
        if noise.grows:
            along = beams(model, self.values, poses, points, self.cell.instrument)
            J = noise.whitening(along, np.full(points.shape[:-1], np.nan)) @ J
        else:
            J = J / noise.along
        if visible is not None:
            J = J * visible[:, :, None, None]
        p = J.shape[-1]
        return (J.reshape(-1, p) @ self.T).reshape(len(poses), -1, p)

    def information(self, q: Array, visible: NDArray[np.bool_] | None = None) -> Array:
        """Information matrix of each configuration, shape (m, p, p)."""
        rows = self.rows(q, visible)
        return np.swapaxes(rows, -1, -2) @ rows

    def whitened(self, mean: Array) -> Regressor:
        """The same in coordinates in which ``mean`` (p, p), in the present ones, is the identity."""
        L = np.linalg.cholesky(mean)
        return replace(self, T=self.T @ np.linalg.inv(L).T)


def _tiled(visible: NDArray[np.bool_], poses: Poses, q: Array) -> NDArray[np.bool_]:
    return np.tile(visible, (len(poses) // len(q), 1))
