"""Whether what was found predicts configurations that it never saw.

Configurations are left out a tenth at a time, and predicted by a fit to first order to the others. What
depends on time or temperature must predict whole stretches of the session, a tenth each, for readings
close in time err alike. Longer ones would leave out all that a warm-up does. What is fitted anew was
chosen by the same poses, so this says a little too much of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib.arrays import Array, IntArray, stacked
from calib.diagnosis.candidates import Candidate
from calib.diagnosis.gap import blocks_of_time
from calib.diagnosis.refused import Why
from calib.diagnosis.stage import Fit, Stage
from calib.diagnosis.state import with_curves
from calib.effects.protocol import Effect
from calib.noise import unwhitened
from calib.poses import Poses

_FOLDS = 10  # of configurations, or stretches of time
_LEAST = 1.0  # variance of a reading: what gains less does nothing
_RIDGE = 1e-9  # of a direction's information: what nothing but the fold tells stays as it was
BY_TIME = ("time", "temperature")


@dataclass(frozen=True, eq=False)
class PredictionErrors:
    """Errors at left-out poses, with and without some effects.

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
        """Whether left-out poses are predicted better with it, and not by the luck of a few poses."""
        return self.without - self.with_it > max(self.margin, _LEAST)


@dataclass(frozen=True, eq=False)
class CrossValidation:
    """Poses of a fit, each predicted by the others; fold : ndarray of int, shape (m,), of each pose."""

    stage: Stage
    fit: Fit
    fold: IntArray

    @classmethod
    def of(cls, stage: Stage, fit: Fit, by_time: bool) -> CrossValidation:
        """By configurations, or by stretches of the session."""
        poses = stage.data.poses
        fold = blocks_of_time(poses, _FOLDS) if by_time else _by_configurations(poses)
        return cls(stage, fit, fold)

    def errors(self, own: Sequence[Effect], gone: Sequence[Effect] = ()) -> PredictionErrors:
        """Errors with and without some of the effects, others being gone."""
        left = self._predicted(gone) if gone else self._whole
        less = self._predicted([*gone, *own])
        errors = np.stack([left, less], axis=-1)
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
            rms_without=self._rms(less),
        )

    @cached_property
    def _columns(self) -> tuple[Array, Array, Array]:
        """Columns (m, R, k), what is held of them (h, k), normal matrices without folds (F, k, k)."""
        linear = self.fit.linear
        X, held = linear.J @ linear.span, linear.prior_weight * linear.held @ linear.span
        lengths = np.sqrt((X**2).sum(axis=(0, 1)) + (held**2).sum(axis=0))
        lengths = np.where(lengths > 0.0, lengths, 1.0)
        X, held = X / lengths, held / lengths
        of_folds = np.stack([_square(stacked(X[here])) for here in self._folds])
        whole = of_folds.sum(axis=0) + _square(held) + _RIDGE * np.eye(len(lengths))
        return X, held, whole - of_folds

    @cached_property
    def _folds(self) -> list[IntArray]:
        return [np.flatnonzero(self.fold == f) for f in range(int(self.fold.max()) + 1)]

    @cached_property
    def _whole(self) -> Array:
        return self._predicted(())

    def _predicted(self, gone: Sequence[Effect]) -> Array:
        """Residuals (m, R) of poses as the others predict them, some effects being gone."""
        linear, (X, held, without) = self.fit.linear, self._columns
        own = np.array([i for e in gone for i in self.fit.positions(e)], dtype=np.int_)
        values = self.fit.moving[own]
        r, off = linear.r + linear.J[..., own] @ values, linear.off + linear.held[:, own] @ values
        kept = np.flatnonzero(~np.abs(linear.span[own]).any(axis=0))
        X, held, A = X[..., kept], held[:, kept], without[:, kept[:, None], kept]
        each = [np.tensordot(X[here], r[here], axes=([0, 1], [0, 1])) for here in self._folds]
        b = np.sum(each, axis=0) + linear.prior_weight * held.T @ off - each
        steps, out = np.linalg.solve(A, b[..., None])[..., 0], r.copy()
        for here, step in zip(self._folds, steps, strict=True):
            out[here] -= X[here] @ step
        return out

    def _rms(self, errors: Array) -> float:
        """3-D root mean square per point, m, of whitened errors (m, R)."""
        stage, lengths = self.stage, self.stage.model.readout.channels.lengths
        counted = stage.data.seen & ~stage.dropped[:, None] & lengths.any(axis=-1)
        points = unwhitened(stage.weights, stage.data.in_place(errors)) * lengths
        return float(np.sqrt((points[counted] ** 2).sum() / max(1, counted.sum())))


def _square(X: Array) -> Array:
    return np.asarray(X.T @ X)


def _by_configurations(poses: Poses) -> IntArray:
    count = int(poses.configuration.max()) + 1
    drawn = np.random.default_rng(0).permutation(count) % min(_FOLDS, count)
    return np.asarray(drawn[poses.configuration])


def crossed(
    stage: Stage, fit: Fit, found: Sequence[Effect], by_time: bool = False
) -> tuple[float, float] | None:
    """Errors at what was left out, without and with all that was found, 3-D RMS, m; None without any.

    by_time : whether stretches of time are left out
    """
    if not found:
        return None
    errors = CrossValidation.of(stage, fit, by_time).errors(found)
    return errors.rms_without, errors.rms_with


def unsupported(stage: Stage, fit: Fit, active: Sequence[Candidate]) -> dict[str, Why]:
    """Keys of the causes of a fit with which left-out poses are predicted no better, and why.

    Of two that follow the clock alike neither gains beside the other: the better one is asked alone.
    """
    each = {way: CrossValidation.of(stage, fit, way) for way in (False, True)}
    found: dict[str, Why] = {}
    for c in active:
        timed = c.depends_on in BY_TIME
        if not each[timed].errors([o.effect for o in with_curves(c, active)]).earns:
            found[c.key] = "time" if timed else "configurations"
    lost = [c for c in active if c.named and found.get(c.key) == "time"]
    if len(lost) > 1:
        alone = [
            each[True].errors([c.effect], [o.effect for o in lost if o is not c]) for c in lost
        ]
        best = int(np.argmin([errors.with_it for errors in alone]))
        if alone[best].earns:
            del found[lost[best].key]
    return found
