"""What readings tell to first order: the rows of those in hand, of those to come, of candidates.

The readings of one visit share what its approach was off by. So their rows are those of
``V^-1/2 J`` with ``V = s^2 I + H U H^T``, H the levers of joints and tip, U the arm's variances, s the
instrument's actual noise over the stated one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from calib.arrays import Array, IntArray, Mask
from calib.cell import Cell
from calib.effects.protocol import Effect
from calib.model import Model
from calib.poses import Measurements, Poses
from calib.scatter import Scatter, Variances, scatter_of
from calib.scatter.poses import Mixing

Visits = tuple[IntArray, IntArray]


@dataclass(frozen=True, eq=False)
class Rows:
    """Whitened rows (m, R, p) of m readings, and what makes them independent, None where they are."""

    whitened: Array
    mixing: Mixing | None

    @property
    def independent(self) -> Array:
        """Rows of unit variance, (m, R, p): each less what those before it in its visit tell."""
        return self.whitened if self.mixing is None else self.mixing(self.whitened)

    def per(self, sizes: Array) -> Rows:
        """The same with the parameters in units of some sizes, (p,)."""
        return Rows(self.whitened * sizes, self.mixing)

    @property
    def flat(self) -> Array:
        """The same one below the other, (m R, p)."""
        return self.independent.reshape(-1, self.whitened.shape[-1])


@dataclass(frozen=True, eq=False)
class Linearisation:
    """A model to first order about some values, and how its readings err.

    values : ndarray, shape (p,), SI
    arm : Variances, of whole poses, the instrument's actual over stated noise among them
    silent : effects that these readings do not have
    """

    cell: Cell
    model: Model
    values: Array
    arm: Variances
    silent: tuple[Effect, ...] = ()

    def of(self, data: Measurements, kept: Mask | None = None) -> Rows:
        """Rows of readings, of which some count, shape (m,); beams end at their points."""
        return self._rows(data.poses, lambda _: self.weights(data, kept), None)

    def weights(self, data: Measurements, kept: Mask | None = None) -> Array:
        """Whitening matrices of readings, shape (m, C, r, r), zero for what does not count."""
        seen = data.seen if kept is None else data.seen & kept[:, None]
        W = self._whitening(data.poses, data.readings, data.sigma)
        return np.asarray(W * seen[..., None, None])

    def candidates(self, poses: Poses, seen: Mask | None, visit: Visits, sigma: float) -> Rows:
        """Rows of poses that may be read; beams end where they are predicted.

        seen : ndarray of bool, shape (m, M), markers in sight, all where it is None
        visit : approach and configuration of each reading, (m,): candidates come in no order
        sigma : m, standard deviation of every point, NaN for that of the cell
        """
        return self._rows(poses, lambda points: self.foreseen(poses, points, seen, sigma), visit)

    def levers(self, poses: Poses, seen: Mask, visit: Visits) -> Array:
        """How such poses follow the tip, in the instrument's standard deviations, (m, R, 6)."""
        W = self.foreseen(poses, self.model.predict(self.values, poses), seen, np.nan)
        return weighted(W, self.scatter(poses, visit).levers[..., -6:])

    def scatter(self, poses: Poses, visit: Visits | None = None) -> Scatter:
        """How readings err together; visit : as above, as the poses say without it."""
        found = scatter_of(self.model, self.values, poses, self.arm)
        if visit is None:
            return found
        return replace(found, approach=visit[0], configuration=visit[1])

    def _rows(self, poses: Poses, weights: Callable[[Array], Array], visit: Visits | None) -> Rows:
        # A model of its own: the last linearisation that a model remembers is no use to others.
        points, J = replace(self.model).jacobian(self.values, poses)
        W = weights(points)
        rows = weighted(W, self._heard(J))
        if not self.arm.any:
            return Rows(rows / self.arm.scale, None)
        scatter = self.scatter(poses, visit)
        return Rows(rows, scatter.mixing(weighted(W, scatter.levers)))

    def foreseen(self, poses: Poses, points: Array, seen: Mask | None, sigma: float) -> Array:
        """Whitening matrices (m, C, r, r), or one number for a row (m, C, 1, 1) where that will do.

        Of :meth:`candidates`; points : where they are predicted, (m, C, r)
        """
        even = self.model.readout.even
        if np.isnan(sigma) and even is not None:
            counted = np.ones(points.shape[:-1], dtype=bool) if seen is None else seen
            return np.where(counted, 1.0 / even, 0.0)[..., None, None]
        W = self._whitening(poses, points, np.full(points.shape[:-1], sigma))
        return W if seen is None else W * seen[..., None, None]

    def _whitening(self, poses: Poses, points: Array, sigma: Array) -> Array:
        return self.model.readout.whitening(self.values, poses, points, sigma)

    def _heard(self, J: Array) -> Array:
        """Derivatives (m, C, r, p) without those by what is silent."""
        if not self.silent:
            return J
        heard = J.copy()
        for effect, part in zip(self.model.effects, self.model.slices, strict=True):
            if any(effect is other for other in self.silent):
                heard[..., part] = 0.0
        return heard


def weighted(W: Array, columns: Array) -> Array:
    """Columns (m, C, r, k) in standard deviations, the coordinates of a reading one after the other.

    W : ndarray, shape (m, C, r, r), or (m, C, 1, 1) for what is weighed alike
    """
    rows = columns * W if W.shape[-1] == 1 else W @ columns
    return np.asarray(rows.reshape(len(columns), -1, columns.shape[-1]))
