"""What a pose tells: rows and information blocks of many configurations.

Visits are independent, so information adds up over them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib.api import readings
from calib.arrays import Array, IntArray, Mask, stacked
from calib.cell import Cell
from calib.model import Model
from calib.poses import Measurements, Poses, poses_at
from calib.scatter import Variances
from doe.problem.common import errors_of, moved_rows
from doe.problem.linearisation import Linearisation


@dataclass(frozen=True, eq=False)
class Regressor:
    """Candidates of a cell before anything is known, in the coordinates of the criteria.

    values : ndarray, shape (p,), SI, where the model is linearised
    T : ndarray, shape (p, p), ``theta = T y``
    silent : whether readings free of load carry nothing, and are left out
    """

    cell: Cell
    model: Model
    values: Array
    T: Array
    silent: bool = False

    @cached_property
    def known(self) -> Array:
        """What is known beside all readings as independent rows, (k, p): lengths, lenses, the type."""
        return self.model.beside(self.values)[1] @ self.T

    @property
    def rank(self) -> int:
        """Rows that one configuration brings, or the number of parameters if that is less."""
        readings_each = 1 if self.silent or self.cell.load is None else 2
        numbers = int(self.model.readout.channels.rows.sum())
        return int(min(numbers * readings_each, self.T.shape[1]))

    @cached_property
    def linearisation(self) -> Linearisation:
        """The noise as the cell says it."""
        arm = Variances.of_arm(self.model.robot.dof, self.cell.repeatability)
        return Linearisation(self.cell, self.model, self.values, arm)

    def rows(self, q: Array, visible: Mask | None = None) -> Array:
        """Independent rows of all readings of each visit, in standard deviations, (m, rows, p).

        q : ndarray, shape (m, dof), a visit each; visible : ndarray, shape (m, M), markers in sight,
            all without it
        """
        poses, visit = self._readings(q)
        # What carries nothing of the model still tells what the approach was off by.
        first = len(q) if self.silent else 0
        if not self.cell.scatters:
            poses, visit, first = poses.take(slice(first, None)), visit[first:], 0
        seen = None if visible is None else visible[visit]
        rows = self.linearisation.candidates(poses, seen, (visit, visit), np.nan).independent
        turned = stacked(rows[first:]) @ self.T
        return _by_visit(turned.reshape(-1, *rows.shape[1:]), len(q))

    def levers(self, q: Array, visible: Mask) -> Array:
        """How a visit's readings follow the tip, in the instrument's standard deviations, (m, rows, 6).

        q : ndarray, shape (m, dof); visible : ndarray of bool, shape (m, M)
        """
        poses, visit = self._readings(q)
        return _by_visit(self.linearisation.levers(poses, visible[visit], (visit, visit)), len(q))

    def crossed(self, q: Array, visible: Mask) -> Array:
        """``J' W J_b`` of each visit by errors common to all readings, one standard uncertainty of each
        component, shape (m, p, b).

        q : ndarray, shape (m, dof); visible : ndarray of bool, shape (m, M)
        """
        if not errors_of(self.model):
            return np.zeros((len(q), len(self.T), 0))
        at, (poses, visit) = self.linearisation, self._readings(q)
        seen, points = visible[visit], self.model.predict(self.values, poses)
        data = Measurements(poses, points, seen, np.full(seen.shape, np.nan))
        rows = at.candidates(poses, seen, (visit, visit), np.nan)
        moved = moved_rows(at, data, at.foreseen(poses, points, seen, np.nan), rows)
        own, more = (_by_visit(r.independent, len(q)) for r in (rows, moved))
        return np.asarray(self.T.T @ np.swapaxes(own, -1, -2) @ more)

    def _readings(self, q: Array) -> tuple[Poses, IntArray]:
        """The readings of visits, all free and then all loaded, and the visit of each."""
        poses = readings(self.cell, poses_at(q, names=[""] * len(q)))
        return poses, np.arange(len(poses)) % len(q)

    def information(self, q: Array, visible: Mask | None = None) -> Array:
        """Information matrix of each configuration, shape (m, p, p)."""
        rows = self.rows(q, visible)
        return np.swapaxes(rows, -1, -2) @ rows

    def whitened(self, mean: Array) -> Regressor:
        """The same in coordinates in which ``mean`` (p, p), in the present ones, is the identity."""
        L = np.linalg.cholesky(mean)
        return replace(self, T=self.T @ np.linalg.inv(L).T)


def _by_visit(rows: Array, visits: int) -> Array:
    """Rows (m, R, k) of one visit beside each other, shape (visits, rows, k)."""
    return np.concatenate(list(rows.reshape(-1, visits, *rows.shape[1:])), axis=1)
