"""Whether what was found predicts configurations that it never saw.

A configuration that is left out is predicted by what the others say. To first order no refit is
needed: with Q an orthonormal basis of the fitted columns, the residual of rows F that are left out
is ``(I - Q_F Q_F^T)^-1 r_F``. What depends on time or temperature must predict whole stretches of
the session, for readings close in time err alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib.arrays import Array, IntArray, Mask, stacked
from calib.diagnosis.gap import blocks_of_time
from calib.diagnosis.prior import held_rows
from calib.diagnosis.stage import Fit, Stage
from calib.effects.protocol import Effect
from calib.noise import unwhitened
from calib.poses import Poses

_FOLDS = 10
_QUARTERS = 4
_FREE = 1e-4  # of a row's freedom: less, and nothing but the fold itself tells of it
BY_TIME = ("time", "temperature")


@dataclass(frozen=True, eq=False)
class Ledger:
    """Squared errors of what was left out, with and without some effects.

    with_it, without : float, in variances of the readings; rms_with, rms_without : float, m, 3-D
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
        return self.without - self.with_it > self.margin


@dataclass(frozen=True, eq=False)
class Choice:
    """A cause at one tuning.

    rows : ndarray, shape (m, R, k), whitened derivatives; limits : ndarray, shape (k,), largest amounts
    """

    rows: Array
    limits: Array


@dataclass(frozen=True, eq=False)
class CrossValidation:
    """What each of the fitted effects does for poses left out, from one factorisation of the fit.

    stage : Stage; fit : Fit
    """

    stage: Stage
    fit: Fit

    def ledger(
        self, effects: Sequence[Effect], by_time: bool, choices: Sequence[Choice] = ()
    ) -> Ledger:
        """What some of the effects do together.

        by_time : whether stretches of the session are left out, else configurations
        choices : what may stand in their place; without a fold the best of them is chosen anew
        """
        folds, kept = self._by_time if by_time else self._by_configuration, self._kept
        fit, (m, R) = self.fit, self.fit.r.shape
        own = np.concatenate([fit.positions(effect) for effect in effects])
        lost = np.abs(fit.span[own]).sum(axis=0) > 0.0
        # Directions that nothing of the rest sees: what the effects alone explain.
        u, _ = np.linalg.qr(kept.duals[lost].T)
        r = kept.r + kept.J[:, own] @ fit.moving[own]
        alone = kept.Q @ u
        r = r - kept.Q @ (kept.Q.T @ r) + alone @ (alone.T @ r)
        gone = folds.without(u, r[: m * R].reshape(m, R, 1))[..., 0]
        left = self._anew(folds, u, r, choices) if choices else folds.left
        costs = [_costs(fit, e) for e in (left, gone)]
        return Ledger(
            with_it=float(costs[0].sum()),
            without=float(costs[1].sum()),
            margin=_standard_error(costs[1] - costs[0], self.stage.data.poses.configuration),
            rms_with=_rms(self.stage, fit, left),
            rms_without=_rms(self.stage, fit, gone),
        )

    def _anew(self, folds: Folds, u: Array, r: Array, choices: Sequence[Choice]) -> Array:
        """Residuals (m, R) of poses predicted by what is best without their fold.

        u : ndarray, shape (k, c), directions of the fit that are free; r : ndarray, shape (N,)
        With M what projects out the rest and K what predicts a fold F by the others, these say of
        columns X ``S = X^T M X - (M X)_F^T K (M X)_F``, of the residual alike.
        """
        kept, (m, R), pull = self._kept, self.fit.r.shape, self.fit.pull
        at_poses = r[: m * R].reshape(m, R, 1)
        best = folds.without(u, at_poses)[..., 0]
        nothing, worth = best.copy(), np.zeros(len(folds.folds))
        rows = int(np.count_nonzero(np.abs(self.fit.J).sum(axis=-1)))
        price = float(np.log(max(2, rows)))
        for choice in choices:
            X = np.zeros((len(r), choice.rows.shape[-1]))
            X[: m * R] = stacked(choice.rows)
            X = X - kept.Q @ (kept.Q.T @ X - u @ (u.T @ (kept.Q.T @ X)))
            back = folds.without(u, X[: m * R].reshape(m, R, -1))
            S, z = X.T @ X + np.diag((pull / choice.limits) ** 2), X.T @ r
            for f, fold in enumerate(folds.folds):
                own, missed = stacked(X[: m * R].reshape(m, R, -1)[fold.here]), back[fold.here]
                z_f = z - own.T @ nothing[fold.here].ravel()
                b = np.linalg.lstsq(S - own.T @ stacked(missed), z_f, rcond=1e-12)[0]
                gain = float(z_f @ b) / pull**2 - len(b) * price
                if gain > worth[f]:
                    worth[f], best[fold.here] = gain, nothing[fold.here] - missed @ b
        return best

    @cached_property
    def _kept(self) -> Kept:
        fit = self.fit
        off, held = held_rows(fit.model, fit.amplitudes, fit.values, fit.pull)
        J = np.concatenate([stacked(fit.J), held])
        r = np.concatenate([fit.r.ravel(), off])
        A = J @ fit.span
        scale = np.linalg.norm(A, axis=0)
        Q, T = np.linalg.qr(A / np.where(scale > 0.0, scale, 1.0))
        return Kept(Q, J, r, np.linalg.pinv(T))

    @cached_property
    def _by_configuration(self) -> Folds:
        return self._over(_folds(self.stage.data.poses, by_time=False))

    @cached_property
    def _by_time(self) -> Folds:
        return self._over(_folds(self.stage.data.poses, by_time=True))

    def _over(self, fold: IntArray) -> Folds:
        (m, R), kept = self.fit.r.shape, self._kept
        r = (kept.r - kept.Q @ (kept.Q.T @ kept.r))[: m * R].reshape(m, R)
        Q = kept.Q[: m * R].reshape(m, R, -1)
        return Folds(tuple(_fold(Q, fold == f) for f in range(int(fold.max()) + 1)), r)


@dataclass(frozen=True, eq=False)
class Kept:
    """A fit's rows, those of the prior last, and a basis of its columns.

    Q : ndarray, shape (N, k), orthonormal; J : ndarray, shape (N, p); r : ndarray, shape (N,)
    duals : ndarray, shape (k, k), in the directions Q: each sees one column and none of the others
    """

    Q: Array
    J: Array
    r: Array
    duals: Array


@dataclass(frozen=True, eq=False)
class Fold:
    """Poses that are left out together.

    here : ndarray of bool, shape (m,); Q : ndarray, shape (n, k), their rows of the basis
    inverse : ndarray, shape (k, k), ``(I - Q^T Q)^-1``
    """

    here: Mask
    Q: Array
    inverse: Array

    def predicted(self, rows: Array) -> Array:
        """``(I - Q Q^T)^-1`` of rows (n, c): what they leave when the others predict them."""
        return np.asarray(rows + self.Q @ (self.inverse @ (self.Q.T @ rows)))


@dataclass(frozen=True, eq=False)
class Folds:
    """All folds; r : ndarray, shape (m, R), residuals of the fit."""

    folds: tuple[Fold, ...]
    r: Array

    @cached_property
    def left(self) -> Array:
        """Residuals (m, R) of poses predicted without their fold."""
        return self.without(np.zeros((self.folds[0].Q.shape[1], 0)), self.r[..., None])[..., 0]

    def without(self, u: Array, r: Array) -> Array:
        """The same with directions u (k, c) no longer fitted, of rows r (m, R, ..) as they are then.

        ``(I - Q Q^T + W W^T)^-1`` by Woodbury, W the directions' rows in the fold.
        """
        out = np.zeros(r.shape)
        for fold in self.folds:
            W = fold.Q @ u
            back, left = fold.predicted(W), fold.predicted(stacked(r[fold.here]))
            left = left - back @ np.linalg.solve(np.eye(u.shape[1]) + W.T @ back, W.T @ left)
            out[fold.here] = left.reshape(r[fold.here].shape)
        return out


def _folds(poses: Poses, by_time: bool) -> IntArray:
    """Number of the fold of each pose, shape (m,)."""
    if by_time:
        return blocks_of_time(poses, _QUARTERS)
    count = int(poses.configuration.max()) + 1
    drawn = np.random.default_rng(0).permutation(count) % min(_FOLDS, count)
    return np.asarray(drawn[poses.configuration])


def _fold(Q: Array, here: Mask) -> Fold:
    own = stacked(Q[here])
    values, vectors = np.linalg.eigh(np.eye(own.shape[1]) - own.T @ own)
    return Fold(here, own, (vectors / np.maximum(values, _FREE)) @ vectors.T)


def _costs(fit: Fit, errors: Array) -> Array:
    """Sum of squares of the independent rows of each pose, shape (m,)."""
    if fit.mixing is not None:
        errors = fit.mixing(errors[..., None])[..., 0]
    return np.asarray((errors**2).sum(axis=-1))


def _standard_error(gained: Array, configuration: IntArray) -> float:
    """Of the sum of what poses gained (m,), those of one configuration together."""
    each = np.bincount(configuration, gained)
    return float(np.sqrt(len(each)) * each.std())


def _rms(stage: Stage, fit: Fit, errors: Array) -> float:
    """3-D root mean square per point, m, of whitened errors (m, R)."""
    counted = stage.data.seen & ~stage.dropped[:, None]
    weights = stage.weights * np.maximum(fit.weight, 1e-9)[:, None, None, None]
    points = unwhitened(weights, errors.reshape(weights.shape[:-1]))
    return float(np.sqrt((points[counted] ** 2).sum() / max(1, counted.sum())))
