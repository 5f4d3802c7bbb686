"""Whether what was found predicts configurations that it never saw.

A configuration that is left out is predicted by what the others say. To first order no refit is
needed: with Q an orthonormal basis of the fitted columns, the residual of rows F that are left out
is ``(I - Q_F Q_F^T)^-1 r_F``. What depends on time or temperature must predict whole stretches of
the session, for readings close in time err alike.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.diagnosis.candidates import Candidate
from calib.diagnosis.gap import blocks_of_time
from calib.diagnosis.prior import prior_rows
from calib.diagnosis.stage import Fit, Stage
from calib.poses import IntArray, Poses
from calib.se3 import Array

_FOLDS = 10
_QUARTERS = 4
_FREE = 1e-4  # of a row's freedom: less, and nothing but the fold itself tells of it
BY_TIME = ("time", "temperature")


@dataclass(frozen=True, eq=False)
class Ledger:
    """Squared errors of what was left out, with and without some candidates.

    with_it, without : float, in variances of the readings; rms_with, rms_without : float, m, 3-D
    """

    with_it: float
    without: float
    rms_with: float
    rms_without: float

    @property
    def earns(self) -> bool:
        """Whether it predicts better than nothing does."""
        return self.with_it < self.without


def ledger(stage: Stage, fit: Fit, candidates: list[Candidate], by_time: bool) -> Ledger:
    """What some of the fitted candidates do for poses left out.

    by_time : whether stretches of the session are left out, else configurations
    """
    fold = _folds(stage.data.poses, by_time)
    own = np.concatenate([fit.positions(c.effect) for c in candidates])
    prior = fit.pull * prior_rows(fit.model, fit.amplitudes)
    J = np.concatenate([fit.J.reshape(-1, fit.J.shape[-1]), prior])
    r = np.concatenate([fit.r.ravel(), -prior @ fit.values])
    A = J @ fit.span
    left = _left_out(A, r, fit, fold)
    rest = fit.span[:, np.abs(fit.span[own]).sum(axis=0) == 0.0]
    kept = np.ones(len(J), dtype=bool)
    kept[fit.r.size :] = np.abs(prior[:, own]).sum(axis=1) == 0.0
    before = (r + J[:, own] @ fit.moving[own])[kept]
    gone = _left_out(J[kept] @ rest, before, fit, fold)
    return Ledger(
        *(_cost(fit, e) for e in (left, gone)), *(_rms(stage, fit, e) for e in (left, gone))
    )


def _folds(poses: Poses, by_time: bool) -> IntArray:
    """Number of the fold of each pose, shape (m,)."""
    if by_time:
        return blocks_of_time(poses, _QUARTERS)
    count = int(poses.configuration.max()) + 1
    drawn = np.random.default_rng(0).permutation(count) % min(_FOLDS, count)
    return np.asarray(drawn[poses.configuration])


def _left_out(A: Array, r: Array, fit: Fit, fold: IntArray) -> Array:
    """Residuals (m, R) of poses predicted without their fold; columns A (N, k), residuals r (N,)."""
    m, R = fit.r.shape
    scale = np.linalg.norm(A, axis=0)
    Q, _ = np.linalg.qr(A / np.where(scale > 0.0, scale, 1.0))
    r = (r - Q @ (Q.T @ r))[: m * R].reshape(m, R)
    Q = Q[: m * R].reshape(m, R, -1)
    out = np.zeros((m, R))
    for f in range(int(fold.max()) + 1):
        here = fold == f
        own = Q[here].reshape(-1, Q.shape[-1])
        # (I - Q Q^T)^-1 r = r + Q (I - Q^T Q)^-1 Q^T r, in the few dimensions of the fit.
        values, vectors = np.linalg.eigh(np.eye(own.shape[1]) - own.T @ own)
        turned = vectors.T @ (own.T @ r[here].ravel()) / np.maximum(values, _FREE)
        out[here] = (r[here].ravel() + own @ (vectors @ turned)).reshape(-1, R)
    return out


def _cost(fit: Fit, errors: Array) -> float:
    """Sum of squares of independent rows."""
    if fit.mixing is not None:
        errors = fit.mixing(errors[..., None])[..., 0]
    return float((errors**2).sum())


def _rms(stage: Stage, fit: Fit, errors: Array) -> float:
    """3-D root mean square per point, m, of whitened errors (m, R)."""
    counted = stage.data.seen & ~stage.dropped[:, None]
    weights = stage.weights * np.maximum(fit.weight, 1e-9)[:, None, None, None]
    hidden = ~counted[..., None, None]
    points = np.linalg.solve(weights + hidden * np.eye(3), errors.reshape(*counted.shape, 3, 1))
    return float(np.sqrt((points[counted] ** 2).sum() / max(1, counted.sum())))
