"""The restricted likelihood of variances, its gradient and its average information.

With V the covariance of the rows by noise and random effects, and the coefficients of blocks written
``c = m + a R z`` with ``z ~ N(0, I)``, the columns ``X = [J D, a X_g R_g]`` have prior rows
``P = [0, I]`` and, for n rows of which b takes s directions,

    -2 log L = (n - s) log 2 pi + log|V| + log|X^T V^-1 X + P^T P| + min_c (|y - X c|_V^2 + |P c|^2)

(Patterson and Thompson, Biometrika 58(3), 1971). By the logarithm of variance j, whose draws move the
rows by columns z_a of unit variance, the slope is ``sum_a z_a^T P z_a - (z_a^T P y)^2``. The mean of
the observed and the expected second derivatives is ``m_j^T P m_k``, ``m_j = sum_a z_a (z_a^T P y)``
(Gilmour, Thompson, Cullis, Biometrics 51(4), 1995). Neither forms a matrix of rows by rows. The noise
of a row is a draw like any other.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import log, pi

import numpy as np

from calib.arrays import Array, stacked
from calib.inference.decorrelation import Decorrelation
from calib.inference.design import Design
from calib.inference.least_squares import inverse_triangle, joined_triangle, triangle
from calib.inference.turned import TurnedRows, turned_rows


@dataclass(frozen=True, eq=False)
class MixedModel:
    """A design, its rows turned.

    inside : ndarray, shape (A, k, f + 1), turned columns and, last, the response
    outside : ndarray, shape (i, f + 1, f + 1), triangles of the rows of each instrument that carry
        noise alone
    """

    design: Design
    turned: TurnedRows
    inside: Array
    outside: Array

    @classmethod
    def of(cls, design: Design) -> MixedModel:
        """Turn the rows of a design."""
        turned = turned_rows(design)
        rows = np.column_stack([design.columns, design.response])
        inside = turned.inside(rows)
        left = rows - turned.spread(inside)
        own = [triangle(left[design.instrument == i]) for i in range(design.instruments)]
        return cls(design, turned, inside, np.reshape(own, (-1, *[rows.shape[1]] * 2)))


@dataclass(frozen=True, eq=False)
class RestrictedLikelihood:
    """Of variances theta (t,): instruments, effects, squared amplitudes of free blocks."""

    model: MixedModel
    theta: Array

    @cached_property
    def decorrelation(self) -> Decorrelation:
        """Of the turned rows."""
        design = self.model.design
        count = design.instruments + len(design.effects)
        return Decorrelation(self.model.turned, self.theta[:count])

    @cached_property
    def scale(self) -> Array:
        """Amplitude of each column, and one for the response, shape (f + 1,)."""
        design = self.model.design
        return np.append(design.column_scale(design.variances(self.theta).amplitudes), 1.0)

    @cached_property
    def outside(self) -> Array:
        """Independent rows (i, f + 1, f + 1) for those that carry noise alone."""
        noise = np.sqrt(self.theta[: self.model.design.instruments])
        return np.asarray(self.model.outside * (self.scale / noise[:, None, None]))

    @cached_property
    def inside(self) -> Array:
        """Independent rows (A, k, f + 1) of the turned ones."""
        return self.decorrelation(self.model.inside * self.scale)

    @cached_property
    def R(self) -> Array:
        """Triangle (f + 1, f + 1) of all independent rows, prior rows included."""
        prior = np.pad(self.model.design.prior_rows, ((0, 0), (0, 1)))
        return joined_triangle([stacked(self.outside), stacked(self.inside), prior])

    @cached_property
    def inverse(self) -> Array:
        """Root W (f, f): ``W W^T`` is the covariance of the coefficients of the columns."""
        return inverse_triangle(self.R[:-1, :-1])

    @cached_property
    def coefficients(self) -> Array:
        """Generalised least-squares coefficients of the columns, shape (f,)."""
        return np.asarray(self.inverse @ self.R[:-1, -1])

    @cached_property
    def value(self) -> float:
        """-2 log likelihood."""
        design = self.model.design
        noise = self.model.turned.outside @ np.log(self.theta[: design.instruments])
        columns = 2.0 * np.log(np.abs(np.diag(self.R)[:-1])).sum()
        fixed = design.freedom * log(2.0 * pi) + self.R[-1, -1] ** 2
        return float(fixed + noise + self.decorrelation.log_det + columns)

    @cached_property
    def _combined(self) -> Array:
        """Combinations (f + 1, f + 1): columns made orthonormal, and last the response's residual."""
        last = np.append(-self.coefficients, 1.0)
        return np.column_stack([np.pad(self.inverse, ((0, 1), (0, 0))), last])

    @cached_property
    def orthonormal(self) -> Array:
        """Independent rows (A, k, f + 1) of the combinations."""
        return np.asarray((stacked(self.inside) @ self._combined).reshape(self.inside.shape))

    @cached_property
    def weighted(self) -> Array:
        """Product of the inverse covariance with the combinations, turned rows, (A, k, f + 1)."""
        return self.decorrelation.back(self.orthonormal)

    @cached_property
    def derivatives(self) -> tuple[Array, Array]:
        """Gradient (t,) and average information (t, t) of -2 log L by log variances."""
        design, turned = self.model.design, self.model.turned
        count, t = design.instruments, len(self.theta)
        gradient, alone = np.zeros(t), self.outside @ self._combined
        taken = (alone[..., :-1] ** 2).sum(axis=(1, 2))
        gradient[:count] = turned.outside - taken - (alone[..., -1] ** 2).sum(axis=1)
        inside, outside = np.zeros((*turned.instrument.shape, t)), np.zeros((*alone.shape[:2], t))
        outside[range(count), :, range(count)] = alone[..., -1]
        for slope, moved in (self._own, self._shared):
            gradient += slope
            inside += moved
        for j, block in enumerate(design.free_blocks, start=count + len(design.effects)):
            own = np.flatnonzero(design.block_of_column == block)
            W, z = self.inverse[own], self.coefficients[own]
            gradient[j] = len(W) - (W**2).sum() - z @ z
            inside[..., j] += self.model.inside[..., own] @ (self.scale[own] * z)
            outside[..., j] += self.outside[..., own] @ z
        rows = stacked(self.decorrelation(inside))
        along = stacked(self.orthonormal)[:, :-1].T @ rows
        along += np.tensordot(alone[..., :-1], outside, axes=([0, 1], [0, 1]))
        information = rows.T @ rows - along.T @ along
        return gradient, information + np.tensordot(outside, outside, axes=([0, 1], [0, 1]))

    @property
    def _own(self) -> tuple[Array, Array]:
        """Slopes (t,) by noise and draws of single cells, and m_j (A, k, t), turned rows."""
        outer, w = self.model.turned.outer, self.weighted
        own = np.zeros(len(self.theta))
        own[: len(outer)] = self.theta[: len(outer)]
        left = self.decorrelation.inverse - w @ np.swapaxes(w, -1, -2)
        slope, moved = np.zeros(len(own)), np.zeros((*w.shape[:2], len(own)))
        slope[: len(outer)] = outer.reshape(len(outer), -1) @ left.ravel()
        moved[..., : len(outer)] = np.moveaxis((outer * w[:, None, :, -1]).sum(axis=-1), 0, -1)
        return own * slope, own * moved

    @property
    def _shared(self) -> tuple[Array, Array]:
        """The same by draws that cells share."""
        turned, own = self.model.turned, self.decorrelation
        effect = self.model.design.instruments + turned.shared_of[0]
        of = np.eye(len(self.theta))[effect]
        E = turned.sums(np.swapaxes(own.shared, -1, -2) @ self.weighted)
        slope = 1.0 - (own.components.root**2).sum(axis=-1) - (E**2).sum(axis=-1)
        moved = own.shared @ turned.components.spread(of * E[..., -1:])
        return slope.sum(axis=0) @ of, moved
