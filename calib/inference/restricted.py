"""The restricted likelihood of variances, its gradient and its expected information.

With V the covariance of the rows by noise and random effects, and the coefficients of blocks written
``c = m + a R z`` with ``z ~ N(0, I)``, the columns ``X = [J D, a X_g R_g]`` have prior rows
``P = [0, I]`` and, for n rows of which b takes s directions,

    -2 log L = (n - s) log 2 pi + log|V| + log|X^T V^-1 X + P^T P| + min_c (|y - X c|_V^2 + |P c|^2)

(Patterson and Thompson, Biometrika 58(3), 1971). By the logarithm of variance j, whose draws move the
rows by columns z of unit variance, the slope is ``sum_a z_a^T P z_a - (z_a^T P y)^2`` and the expected
second derivative ``sum_ab (z_a^T P z_b)^2``. Neither forms a matrix of rows by rows: by Woodbury

    z_a^T P z_b = [same cell] M_ab - T_a . T_b - E_a . E_b

with M of one cell, T of what the cells of a component share, and E of the columns. The noise of a row
is a draw like any other; the shared draws of a component act as a cell with M the identity.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import log, pi

import numpy as np

from calib.arrays import Array
from calib.inference.decorrelation import Decorrelation
from calib.inference.design import Design
from calib.inference.draws import Draws
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
        count = self.model.design.instruments + len(self.model.design.effects)
        return Decorrelation(self.model.turned, self.theta[:count])

    @cached_property
    def scale(self) -> Array:
        """Amplitude of each column, and one for the response, shape (f + 1,)."""
        design = self.model.design
        first = design.instruments + len(design.effects)
        amplitudes = design.amplitudes(np.sqrt(self.theta[first:]))
        return np.append(design.column_scale(amplitudes), 1.0)

    @cached_property
    def prior(self) -> Array:
        """Prior rows P of columns and response, shape (h, f + 1)."""
        return np.pad(self.model.design.prior_rows, ((0, 0), (0, 1)))

    @cached_property
    def outside(self) -> Array:
        """Independent rows (i, f + 1, f + 1) for those that carry noise alone."""
        theta = self.theta[: self.model.design.instruments]
        return np.asarray(self.model.outside * (self.scale / np.sqrt(theta)[:, None, None]))

    @cached_property
    def inside(self) -> Array:
        """Independent rows (A, k, f + 1) of the turned ones."""
        return self.decorrelation(self.model.inside * self.scale)

    @cached_property
    def R(self) -> Array:
        """Triangle (f + 1, f + 1) of all independent rows."""
        width = len(self.scale)
        return joined_triangle(
            [self.outside.reshape(-1, width), self.inside.reshape(-1, width), self.prior]
        )

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
    def combined(self) -> Array:
        """Combinations (f + 1, f + 1): columns made orthonormal, and last the response's residual."""
        f = len(self.coefficients)
        found = np.zeros((f + 1, f + 1))
        found[:f, :f], found[:f, f], found[f, f] = self.inverse, -self.coefficients, 1.0
        return found

    @cached_property
    def weighted(self) -> Array:
        """Product of the inverse covariance with the combinations, turned rows, (A, k, f + 1)."""
        return self.decorrelation.back(self.inside @ self.combined)

    @cached_property
    def derivatives(self) -> tuple[Array, Array]:
        """Gradient (t,) and expected second derivatives (t, t) of -2 log L by log variances."""
        design, turned = self.model.design, self.model.turned
        count, t = design.instruments, len(self.theta)
        local = count + len(design.effects)
        gradient, information = np.zeros(t), np.zeros((t, t))
        B = np.zeros((t, *self.inverse.shape))  # sum of E^T E by variance
        alone = self.outside @ self.combined
        taken = (alone[..., :-1] ** 2).sum(axis=(1, 2))
        gradient[:count] = turned.outside - taken - (alone[..., -1] ** 2).sum(axis=1)
        information[range(count), range(count)] = turned.outside - 2.0 * taken
        B[:count] = _t(alone[..., :-1]) @ alone[..., :-1]
        for draws in self.draws:
            gradient += draws.slopes(t)
            information += draws.near(t)
            B += draws.squares(t)
        information += self._linked(t)
        information += np.tensordot(B, B, axes=([1, 2], [1, 2]))
        for j, block in enumerate(design.free_blocks, start=local):
            W = self.inverse[design.block_of_column == block]
            z = self.coefficients[design.block_of_column == block]
            gradient[j] = len(W) - (W**2).sum() - z @ z
            information[:local, j] = np.einsum("kf,jfg,kg->j", W, B[:local], W, optimize=True)
            information[j, :local] = information[:local, j]
            for i, other in enumerate(design.free_blocks, start=local):
                C = W @ self.inverse[design.block_of_column == other].T
                information[i, j] = ((C - np.eye(len(W)) if i == j else C) ** 2).sum()
        return gradient, information

    def _linked(self, t: int) -> Array:
        """What draws of different cells of a component have in common, shape (t, t)."""
        turned = self.model.turned
        if not turned.shared_of.size:
            return np.zeros((t, t))
        cells, shared = self.draws
        own = [turned.sums(cells.linked(j)) + shared.linked(j) for j in range(t)]
        flat = np.reshape(own, (t, -1))
        return np.asarray(flat @ flat.T)

    @cached_property
    def draws(self) -> tuple[Draws, Draws]:
        """Own draws of the cells, and shared draws of the components, each of unit variance."""
        turned, own = self.model.turned, self.decorrelation
        count = self.model.design.instruments
        A, k = turned.instrument.shape
        noise = np.sqrt(own.slot_variance)[..., None] * np.eye(k)
        columns = np.concatenate([noise, own.own], axis=-1)
        of_own = np.broadcast_to(count + turned.own_of, (A, len(turned.own_of)))
        owner = np.concatenate([turned.instrument, of_own], axis=1)
        moved = own.L @ columns
        root = own.root[turned.component]
        T = _t(moved) @ own.K @ root
        E = _t(columns) @ self.weighted
        cells = Draws(owner, _t(moved) @ moved, T, E[..., :-1], E[..., -1])
        c = own.K.shape[-1]
        E = turned.sums(_t(own.shared) @ self.weighted)
        owner = np.where(turned.shared_of >= 0, count + turned.shared_of, -1)
        unit = np.broadcast_to(np.eye(c), (len(owner), c, c))
        return cells, Draws(owner, unit, -own.root, E[..., :-1], E[..., -1])


def _t(a: Array) -> Array:
    return np.swapaxes(a, -1, -2)
