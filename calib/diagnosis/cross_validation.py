"""Cross-validation: whether what was found predicts configurations that it never saw.

A configuration that is left out is predicted by what the others say. To first order no refit is
needed: with Q an orthonormal basis of the fitted columns, the residual of rows F that are left out
is ``(I - Q_F Q_F^T)^-1 r_F``. What depends on time or temperature must predict whole stretches of
the session, for readings close in time err alike. Refits of what was found say a little too much of
it, for it was chosen by the same poses.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib.arrays import Array, IntArray, Mask, stacked
from calib.diagnosis.gap import blocks_of_time
from calib.diagnosis.search import Outcome
from calib.diagnosis.stage import Fit, Stage
from calib.effects.protocol import Effect
from calib.linear import LinearProblem
from calib.noise import unwhitened
from calib.poses import Poses

_FOLDS = 10
_STRETCHES = 4
_LEAST = 1.0  # variance of a reading: what gains less does nothing
_FREE = 1e-4  # of a row's freedom: less, and nothing but the fold itself tells of it
BY_TIME = ("time", "temperature")


@dataclass(frozen=True, eq=False)
class PredictionErrors:
    """Prediction errors at left-out poses, with and without some effects.

    with_it, without : float, sums of squares in variances of the readings
    rms_with, rms_without : float, m, 3-D, of numbers that are lengths, of all where none is
    margin : float, standard error of what is gained, from configuration to configuration
    """

    with_it: float
    without: float
    margin: float
    rms_with: float
    rms_without: float

    @property
    def earns(self) -> bool:
        """Whether it predicts better than nothing does, and not by the luck of a few poses."""
        return self.without - self.with_it > max(self.margin, _LEAST)


@dataclass(frozen=True, eq=False)
class Fold:
    """Poses that are left out together.

    here : ndarray of bool, shape (m,); Q : ndarray, shape (n, k), their rows of the basis
    inverse : ndarray, shape (k, k), ``(I - Q^T Q)^-1``
    """

    here: Mask
    Q: Array
    inverse: Array

    @classmethod
    def of(cls, Q: Array, here: Mask) -> Fold:
        """Of the basis at all poses, (m, R, k)."""
        own = stacked(Q[here])
        values, vectors = np.linalg.eigh(np.eye(own.shape[1]) - own.T @ own)
        return cls(here, own, (vectors / np.maximum(values, _FREE)) @ vectors.T)

    def predicted(self, rows: Array, free: Array) -> Array:
        """What rows (n, 1) leave when the others predict them, some directions (k, c) not fitted.

        ``(I - Q Q^T + W W^T)^-1`` by Woodbury, W the rows of these directions.
        """
        W = self.Q @ free
        back, left = (own + self.Q @ (self.inverse @ (self.Q.T @ own)) for own in (W, rows))
        inner = np.eye(free.shape[1]) + W.T @ back
        return np.asarray(left - back @ np.linalg.solve(inner, W.T @ left))


@dataclass(frozen=True, eq=False)
class CrossValidation:
    """Cross-validation of each fitted effect from one factorisation of the fit.

    fold_of : ndarray of int, shape (m,), number of the fold of each pose
    """

    stage: Stage
    fit: Fit
    fold_of: IntArray

    @classmethod
    def of(cls, stage: Stage, fit: Fit, by_time: bool) -> CrossValidation:
        """By configurations, or by stretches of the session."""
        poses = stage.data.poses
        return cls(stage, fit, _by_stretches(poses) if by_time else _by_configurations(poses))

    @cached_property
    def linear(self) -> LinearProblem:
        """The fit by least squares, which is what predicts."""
        return replace(self.fit.linear, mixing=None)

    @cached_property
    def _folds(self) -> tuple[Fold, ...]:
        Q = self.linear.complement.at_readings[1]
        return tuple(Fold.of(Q, self.fold_of == f) for f in range(int(self.fold_of.max()) + 1))

    def errors(self, effects: Sequence[Effect]) -> PredictionErrors:
        """Prediction errors with and without some of the effects."""
        own = np.concatenate([self.fit.positions(effect) for effect in effects])
        rest, free = self.linear.without(own, self.fit.moving[own]).left, self.linear.freed(own)
        left, gone = self._whole, self._predicted(rest, free)
        errors = np.stack([left, gone], axis=-1)
        if self.fit.mixing is not None:
            errors = self.fit.mixing(errors)
        costs = (errors**2).sum(axis=1).T
        # What the poses of one configuration gain goes together.
        gained = np.bincount(self.stage.data.poses.configuration, costs[1] - costs[0])
        return PredictionErrors(
            with_it=float(costs[0].sum()),
            without=float(costs[1].sum()),
            margin=float(np.sqrt(len(gained)) * gained.std()),
            rms_with=self._rms(left),
            rms_without=self._rms(gone),
        )

    @cached_property
    def _whole(self) -> Array:
        complement = self.linear.complement
        return self._predicted(complement.left, np.zeros((complement.Q.shape[1], 0)))

    def _predicted(self, residual: Array, free: Array) -> Array:
        """Residuals (m, R) of poses predicted without their fold."""
        m, R = self.fit.r.shape
        left, out = residual[: m * R].reshape(m, R), np.zeros((m, R))
        for fold in self._folds:
            own = fold.predicted(left[fold.here].reshape(-1, 1), free)
            out[fold.here] = own.reshape(-1, R)
        return out

    def _rms(self, errors: Array) -> float:
        """3-D root mean square per point, m, of whitened errors (m, R)."""
        stage, lengths = self.stage, self.stage.model.readout.channels.lengths
        counted = stage.data.seen & ~stage.dropped[:, None] & lengths.any(axis=-1)
        weights = stage.weights * np.maximum(self.fit.weight, 1e-9)[:, None, None, None]
        points = unwhitened(weights, stage.data.in_place(errors)) * lengths
        return float(np.sqrt((points[counted] ** 2).sum() / max(1, counted.sum())))


def _by_stretches(poses: Poses) -> IntArray:
    return blocks_of_time(poses, _STRETCHES)


def _by_configurations(poses: Poses) -> IntArray:
    count = int(poses.configuration.max()) + 1
    drawn = np.random.default_rng(0).permutation(count) % min(_FOLDS, count)
    return np.asarray(drawn[poses.configuration])


def crossed(stage: Stage, outcome: Outcome, by_time: bool = False) -> tuple[float, float] | None:
    """Errors at what was left out, without and with all that was found, 3-D RMS, m; None without any.

    stage : to first order, that of the outcome; by_time : whether stretches of time are left out
    """
    if not outcome.active:
        return None
    whole = CrossValidation.of(stage, outcome.fit, by_time)
    errors = whole.errors([c.effect for c in outcome.active])
    return errors.rms_without, errors.rms_with
