"""What readings tell to first order: rows of those in hand, to come, of candidates, and at the targets.

The readings of one visit share what its approach was off by, so their rows are those of ``V^-1/2 J``
with ``V = s^2 I + H U H^T``: H the sensitivities to joints and tip, U the arm's variances, s the
instrument's actual noise over the stated one. Only all rows of a visit together tell what it tells.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Self

import numpy as np

from calib.api import readings
from calib.arrays import Array, IntArray, Mask, in_parts, stacked
from calib.cell import Cell
from calib.effects.protocol import ElasticEffect, LoadEffect
from calib.effects.tuned import Tuned
from calib.model import Model
from calib.model.covariance import at_points_read, at_tip, working_points
from calib.observations.linear import LinearProblem
from calib.observations.scatter import Scatter, Variances, scatter_of
from calib.poses import Measurements, Poses, poses_at

_SOFTEST_M = 1e-3  # what an assumed compliance moves the markers by at most


@dataclass(frozen=True, eq=False)
class Linearisation:
    """A model to first order about some values, and how its readings err.

    values : ndarray, shape (p,), SI
    arm : Variances, of whole poses, the instrument's actual over stated noise among them
    """

    cell: Cell
    model: Model
    values: Array
    arm: Variances

    def of(self, data: Measurements, kept: Mask | None = None) -> Rows:
        """Rows of readings, of which some count, shape (m,)."""
        return self._rows(data.poses, lambda _: self.weights(data, kept), None)

    def weights(self, data: Measurements, kept: Mask | None = None) -> Array:
        """Whitening matrices of readings, shape (m, C, r, r), zero for what does not count."""
        seen = data.seen if kept is None else data.seen & kept[:, None]
        W = self.model.readout.whitening(self.values, data.poses, data.readings, data.sigma)
        return np.asarray(W * seen[..., None, None])

    def scatter(self, poses: Poses, visit: IntArray | None = None) -> Scatter:
        """How readings err together; visit : of each one, as the poses say without it."""
        scatter = scatter_of(self.model, self.values, poses, self.arm)
        return scatter if visit is None else replace(scatter, approach=visit, configuration=visit)

    def _rows(
        self, poses: Poses, weights: Callable[[Array], Array], visit: IntArray | None
    ) -> Rows:
        # A model of its own: the last linearisation that a model remembers is no use to others.
        points, J = replace(self.model).jacobian(self.values, poses)
        W = weights(points)
        off, held = self.model.prior_residuals(self.values)
        rows = weighted(W, J)
        if not self.arm.any:
            return Rows(rows if self.arm.scale == 1.0 else rows / self.arm.scale, off, held)
        scatter = self.scatter(poses, visit)
        return Rows(rows, off, held, scatter, weighted(W, scatter.levers))

    def foreseen(self, poses: Poses, points: Array, seen: Mask | None) -> Array:
        """Whitening matrices (m, C, r, r), or one number for a row (m, C, 1, 1) where that will do.

        points : where they are predicted, (m, C, r): there beams end; seen : (m, C)
        """
        even, shape = self.model.readout.even, points.shape[:-1]
        if even is None:
            W = self.model.readout.whitening(self.values, poses, points, np.full(shape, np.nan))
        else:
            W = np.full((*shape, 1, 1), 1.0 / even)
        return np.asarray(W if seen is None else W * seen[..., None, None])


@dataclass(frozen=True, eq=False)
class Rows:
    """Derivatives of m readings in the instrument's standard deviations, and how the arm scatters.

    J : ndarray, shape (m, R, p); off, held : what is known beside the readings, (h,) and (h, p)
    scatter : Scatter, None where readings err alone; levers : ndarray, shape (m, R, k), of it
    weighing : Variances or None, by which a fit weighs whole poses; pull : see ``prior_weight``
    """

    J: Array
    off: Array
    held: Array
    scatter: Scatter | None = None
    levers: Array | None = None
    weighing: Variances | None = None
    pull: float = 1.0

    def take(self, index: Mask) -> Rows:
        """Some of the readings: what the others would tell of the scatter is not known."""
        if self.scatter is None or self.levers is None:
            return replace(self, J=self.J[index])
        levers, scatter = self.levers[index], self.scatter.take(index)
        return replace(self, J=self.J[index], scatter=scatter, levers=levers)

    @cached_property
    def problem(self) -> LinearProblem:
        """The linear problem of all of them."""
        own = replace(LinearProblem.of_rows(self.J), off=self.off, held=self.held)
        own = replace(own, prior_weight=self.pull)
        if self.scatter is None or self.levers is None:
            return own
        weighing = None
        if self.weighing is not None:
            weighing = self.scatter.at(self.weighing).mixing(self.levers)
        return replace(own, mixing=self.scatter.mixing(self.levers), weighing=weighing)


def weighted(W: Array, columns: Array) -> Array:
    """Columns (m, C, r, k) in standard deviations, the coordinates of a reading one after the other.

    W : ndarray, shape (m, C, r, r), or (m, C, 1, 1) for what is weighed alike
    """
    rows = columns * W if W.shape[-1] == 1 else W @ columns
    return np.asarray(rows.reshape(len(columns), -1, columns.shape[-1]))


def by_visit(rows: Array, visits: int) -> Array:
    """Rows (m, R, k) of one visit beside each other, shape (visits, rows, k): all free, then loaded."""
    first, *others = rows.reshape(-1, visits, *rows.shape[1:])
    return np.concatenate([first, *others], axis=1) if others else np.asarray(first)


def nominal(model: Model, poses: Poses) -> Array:
    """The nominal model, shape (p,), SI; as soft as usual where an error of load is to be seen.

    Weights, springs and payloads move the markers through compliances only; the cycles of a ripple and
    a time constant show beside an amplitude only, which is taken as usual.
    """
    values = soft(model, poses) if len(model.where(LoadEffect)) else model.initial
    for effect, part in model.parts:
        if isinstance(effect, Tuned):
            values[part.start + 1 : part.stop] = model.sizes[part.start + 1 : part.stop]
    return values


def soft(model: Model, poses: Poses) -> Array:
    """Nominal, but elastic ones of usual size, or of what moves the markers a millimetre, (p,), SI."""
    values = model.initial
    _, J = model.jacobian(values, poses)
    moved = np.linalg.norm(J, axis=-2).max(axis=(0, 1))
    sizes = np.minimum(model.sizes, _SOFTEST_M / np.maximum(moved, 1e-300))
    elastic = model.where(ElasticEffect)
    values[elastic] = sizes[elastic]
    return values


@dataclass(frozen=True, eq=False)
class Regressor(Linearisation):
    """Candidates of a cell before anything is known, in the coordinates of the criteria.

    T : ndarray, shape (p, p), ``theta = T y``
    """

    T: Array = field(kw_only=True)

    @classmethod
    def nominal(cls, cell: Cell, model: Model, values: Array) -> Self:
        """Per plausible size of each parameter, with the noise as the cell says it."""
        arm = Variances.of_arm(model.robot.dof, cell.repeatability)
        return cls(cell, model, values, arm, T=np.diag(model.sizes))

    @cached_property
    def known(self) -> Array:
        """What is known beside all readings, as independent rows, (k, p): lengths, lenses, sizes."""
        return self.model.prior_residuals(self.values)[1] @ self.T

    @property
    def rank(self) -> int:
        """Rows that one configuration brings, or the number of parameters if that is less."""
        numbers = int(self.model.readout.channels.rows.sum())
        return int(min(numbers * (1 if self.cell.load is None else 2), len(self.T)))

    def rows(self, q: Array, visible: Mask | None = None) -> Array:
        """Independent rows of all readings of each visit, in standard deviations, (m, rows, p).

        q : ndarray, shape (m, dof), one visit each
        visible : ndarray, shape (m, C), readings in sight, all without it
        """
        poses, visit = self._readings(q)
        seen = None if visible is None else visible[visit]
        each = self._rows(poses, lambda points: self.foreseen(poses, points, seen), visit)
        rows = by_visit(each.problem.rows(), len(q))
        return np.asarray((stacked(rows) @ self.T).reshape(rows.shape))

    def sensitivities(self, q: Array, visible: Mask) -> Array:
        """How a visit's readings follow the tip, in the instrument's standard deviations, (m, rows, 6).

        q : ndarray, shape (m, dof), one visit each; visible : ndarray of bool, shape (m, C)
        """
        poses, visit = self._readings(q)
        W = self.foreseen(poses, self.model.predict(self.values, poses), visible[visit])
        return by_visit(weighted(W, self.scatter(poses, visit).levers[..., -6:]), len(q))

    def _readings(self, q: Array) -> tuple[Poses, IntArray]:
        """The readings of visits, all free and then all loaded, and the visit of each."""
        # Names of a million candidates would cost as much as their frames.
        poses = readings(self.cell, poses_at(q, ("",) * len(q)))
        return poses, np.arange(len(poses)) % len(q)

    def information(self, q: Array, visible: Mask | None = None) -> Array:
        """Information matrix of each visit, shape (m, p, p)."""
        p, each = len(self.T), self.model.readout.channels.rows.sum() * len(self.T)
        blocks = np.empty((len(q), p, p))
        for part in in_parts(len(q), int(each)):
            rows = self.rows(q[part], None if visible is None else visible[part])
            np.matmul(np.swapaxes(rows, -1, -2), rows, out=blocks[part])
        return blocks

    def whitened(self, mean: Array) -> Regressor:
        """The same in coordinates in which ``mean`` (p, p), in the present ones, is the identity."""
        return replace(self, T=self.T @ np.linalg.inv(np.linalg.cholesky(mean)).T)


def target_rows(
    model: Model, values: Array, targets: Poses, at_markers: bool | None = None
) -> Array:
    """Position errors at K target poses to first order, the mean over points in the rows, (K, r, p).

    In m per SI unit about values (p,), for the readings of a model.
    at_markers : whether errors count at the markers, else at the tip's origin; None: where the markers
        are unknowns
    """
    points = working_points if at_markers is None else at_points_read if at_markers else at_tip
    _, J = replace(points(model)).jacobian_at_rest(values, targets)
    return np.asarray(J.reshape(len(targets), -1, J.shape[-1]) / np.sqrt(J.shape[1]))
