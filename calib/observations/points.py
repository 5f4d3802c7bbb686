"""Observations: from readings to weighted residuals; approach #2, every reading as it is measured."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Self

import numpy as np

from calib.arrays import Array, IntArray, Mask
from calib.inference.decorrelation import InverseRoot
from calib.model import Model
from calib.noise import counted
from calib.observations.linear import LinearProblem
from calib.observations.scatter import Scatter
from calib.poses import Measurements


@dataclass(frozen=True, eq=False)
class Observation(ABC):
    """How readings become weighted residuals.

    data : Measurements; its points may carry leading axes, one set of readings a trial
    weights : ndarray, shape (m, C, r, r), whitening matrices of the readings, zero for what does not
        count
    known : Scatter or None, how whole poses err together as the cell says it, beside the noise of their
        points: the readings are weighed by it
    scatter : Scatter or None, how they do as the data show it, what is known included. It weighs
        nothing: a model that lacks something would leave it to the joints that scatter most
    lost : positions of values that the readings do not determine: they stay where they are
    prior : ndarray, shape (h, p), or None: rows of unit variance about nothing of what is suspected,
        known beside the readings as well
    prior_weight : what is known beside the readings weighs so many times more than its deviation says,
        as the readings err so many times more than theirs
    """

    model: Model
    data: Measurements
    weights: Array
    known: Scatter | None = field(default=None, kw_only=True)
    scatter: Scatter | None = field(default=None, kw_only=True)
    prior: Array | None = field(default=None, kw_only=True)
    prior_weight: float = field(default=1.0, kw_only=True)
    lost: tuple[int, ...] = field(default=(), kw_only=True)

    @abstractmethod
    def whitened(self, values: Array) -> tuple[Array, Array]:
        """Residuals (..., m, rows), in the instrument's standard deviations, and the derivative."""

    @abstractmethod
    def rows(self, J: Array) -> Array:
        """Weighted rows (..., m, rows, p) of a Jacobian (..., m, C, r, p)."""

    @property
    def efficient(self) -> bool:
        """Whether it is weighted by the inverse of its noise, so that nothing is lost."""
        return True

    @cached_property
    def weighing(self) -> InverseRoot | None:
        """What makes the rows independent as far as the cell knows how they err; None where they are.

        A weighting that is not by the noise leaves this out as well.
        """
        return self._mixing(self.known) if self.efficient else None

    @cached_property
    def mixing(self) -> InverseRoot | None:
        """What makes whitened rows independent under the variances; None where they are."""
        return self._mixing(self.known if self.scatter is None else self.scatter)

    def _mixing(self, scatter: Scatter | None) -> InverseRoot | None:
        if scatter is None or not scatter.variances.any:
            return None
        return scatter.mixing(self.rows(scatter.levers))

    def linearise(self, values: Array) -> tuple[Array, Array]:
        """Residuals (..., m, rows), in standard deviations, and the derivative of the prediction."""
        r, J = self.whitened(values)
        if self.weighing is None:
            return r, J
        return self.weighing(r[..., None])[..., 0], self.weighing(J)

    def flat(self, values: Array) -> tuple[Array, Array]:
        """Residuals (..., N) and derivatives (..., N, p), poses and rows in one axis.

        What is known beside the readings comes last, as it weighs.
        """
        r, J = self.linearise(values)
        r = r.reshape((*r.shape[:-2], -1))
        J = J.reshape((*r.shape, J.shape[-1]))
        if not self.model.known_rows and self.prior is None:
            return r, J
        off, held = (self.prior_weight * rows for rows in self.stated_prior_residuals(values))
        return np.concatenate([r, off], axis=-1), np.concatenate([J, held], axis=-2)

    def stated_prior_residuals(self, values: Array) -> tuple[Array, Array]:
        """Rows of what is known beside the readings, (..., h) and (..., h, p), of unit variance."""
        off, held = self.model.prior_residuals(values)
        if self.prior is None:
            return off, held
        prior = np.broadcast_to(self.prior, (*values.shape[:-1], *self.prior.shape))
        own = -(prior @ values[..., None])[..., 0]
        return np.concatenate([own, off], axis=-1), np.concatenate([prior, held], axis=-2)

    def span(self) -> Array:
        """Directions in which values may move, shape (p, k)."""
        staying = [*self.model.still, *self.lost]
        return np.delete(np.eye(len(self.model.parameters)), staying, axis=1)

    def linear(self, values: Array, span: Array) -> LinearProblem:
        """The problem to first order about ``values`` (p,), fitted along ``span`` (p, k)."""
        rows, known = self.whitened(values), self.stated_prior_residuals(values)
        return LinearProblem(*rows, span, *known, self.mixing, self.weighing, self.prior_weight)

    def covariance(self, values: Array, span: Array) -> Array:
        """Covariance (p, p) of the least-squares values along ``span`` (p, k), the noise as stated."""
        return self.linear(values, span).covariance

    def only(self, kept: Mask) -> Self:
        """The observation with the other poses weighted out; kept has shape (m,)."""
        return replace(self, weights=self.weights * kept[:, None, None, None])

    @property
    def counted(self) -> Mask:
        """Readings that count, shape (m, C)."""
        return np.asarray(self.data.seen & self.weights.any(axis=(-1, -2)))

    @property
    def numbers(self) -> IntArray:
        """How many numbers of each reading count, shape (m, C)."""
        return np.asarray(counted(self.weights) * self.data.seen)


@dataclass(frozen=True, eq=False)
class Points(Observation):
    """Every number of every reading: of a tracker, every coordinate of every marker.

    Rows are those of the c channels that were read, so many of each pose as of the one that has most.
    """

    def whitened(self, values: Array) -> tuple[Array, Array]:
        predicted, J = self.model.jacobian(values, self.data.poses)
        return self.residuals(predicted), self.rows(J)

    def residuals(self, predicted: Array) -> Array:
        """Weighted residuals, shape (..., m, r c)."""
        return self.rows((self.data.readings - predicted)[..., None])[..., 0]

    def rows(self, J: Array) -> Array:
        """Weighted rows of a Jacobian (..., m, C, r, p), shape (..., m, r c, p).

        It may have the c channels alone that are read.
        """
        W = self.weights
        *batch, m, C, _, p = J.shape
        at = np.arange(m)[:, None], self.data.read
        if at[1].shape[1] < W.shape[1]:
            J, W = J if at[1].shape[1] == C else J[(..., *at, slice(None), slice(None))], W[at]
        weighted = W @ J
        return weighted.reshape((*batch, m, math.prod(weighted.shape[-3:-1]), p))


def points_of(observation: Observation) -> Points:
    """The readings behind an observation, weighed by the instrument: by them poses are judged."""
    o = observation
    scatter = o.known if o.scatter is None else o.scatter
    return Points(o.model, o.data, o.weights, scatter=scatter, prior_weight=o.prior_weight)
