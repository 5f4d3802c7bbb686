"""Cross-validation: whether what was found predicts configurations that it never saw.

A configuration that is left out is predicted by what the others say. To first order no refit is
needed: with Q an orthonormal basis of the fitted columns, the residual of rows F that are left out
is ``(I - Q_F Q_F^T)^-1 r_F``. What depends on time or temperature must predict whole stretches of
the session, for readings close in time err alike.

Refits of what was found say too much of it, for it was chosen by the same poses. So in each fold the
best of a cause's close rivals, at any of their tunings, takes its place; the folds themselves decide
nothing. To first order the price of each choice adds up.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from calib.arrays import Array, IntArray, Mask, stacked
from calib.diagnosis.equivalence import CLOSE, Named
from calib.diagnosis.gap import blocks_of_time
from calib.diagnosis.search import Outcome, with_curves
from calib.diagnosis.stage import Fit, Stage
from calib.effects.protocol import Effect
from calib.linear import LinearProblem
from calib.noise import unwhitened
from calib.poses import Poses
from calib.scatter.mixing import Mixing

_FOLDS = 10
_STRETCHES = 4
_LEAST = 1.0  # variance of a reading: what gains less does nothing
_FREE = 1e-4  # of a row's freedom: less, and nothing but the fold itself tells of it
BY_TIME = ("time", "temperature")


@dataclass(frozen=True, eq=False)
class PredictionErrors:
    """Squared prediction errors at left-out poses, with and without some effects.

    with_it, without : float, in variances of the readings; rms_with, rms_without : float, m, 3-D, of
        those numbers that are lengths, of all where none is
    margin : float, standard error of what is gained, from configuration to configuration
    again : float, share of the folds without which the same cause is chosen, where there is a choice
    """

    with_it: float
    without: float
    margin: float
    rms_with: float
    rms_without: float
    again: float = 1.0

    @property
    def earns(self) -> bool:
        """Whether it predicts better than nothing does, and not by the luck of a few poses."""
        return self.without - self.with_it > max(self.margin, _LEAST)


@dataclass(frozen=True, eq=False)
class Alternative:
    """A cause at one tuning that may be chosen in the place of another.

    name : str, the same of all that no reading tells apart
    rows : ndarray, shape (m, R, k), whitened derivatives; limits : ndarray, shape (k,), largest amounts
    """

    name: str
    rows: Array
    limits: Array


@dataclass(frozen=True, eq=False)
class CrossValidation:
    """Cross-validation of each fitted effect from one factorisation of the fit.

    stage : Stage; fit : Fit
    """

    stage: Stage
    fit: Fit
    _last: dict[bool, Predicted] = field(default_factory=dict, init=False, repr=False)

    def ledger(
        self, effects: Sequence[Effect], by_time: bool, alternatives: Sequence[Alternative] = ()
    ) -> PredictionErrors:
        """Prediction errors with and without some of the effects.

        by_time : whether stretches of the session are left out, else configurations
        alternatives : what may stand in their place, the first its own: without a fold the best of them
            is chosen anew
        """
        rest = self._without(effects, by_time)
        gone, left, again = rest.left, self._whole(by_time).left, 1.0
        if alternatives:
            left, again = self._anew(rest, effects, by_time, alternatives)
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
            rms_with=_rms(self.stage, self.fit, left),
            rms_without=_rms(self.stage, self.fit, gone),
            again=again,
        )

    def _anew(
        self,
        plain: Predicted,
        effects: Sequence[Effect],
        by_time: bool,
        alternatives: Sequence[Alternative],
    ) -> tuple[Array, float]:
        """Residuals (m, R) of poses predicted by what is best without their fold.

        effects : in whose place it comes; plain : Without, them
        Besides, of how many folds that is the first of the alternatives, at whatever tuning.
        What is best is told by rows that err independently, what is missed by least squares.
        """
        mixing, judged = self.fit.mixing, plain
        if mixing is not None:
            judged = self._independent._without(effects, by_time)
        best, worth = plain.left.copy(), np.zeros(len(plain.folds))
        same = np.zeros(len(worth), dtype=bool)
        for other in alternatives:
            alike = other if mixing is None else replace(other, rows=mixing(other.rows))
            gains, left = judged.with_alternative(alike)[0], plain.with_alternative(other)[1]
            for f in np.flatnonzero(gains > worth):
                here = plain.folds[f].here
                worth[f], best[here] = gains[f], left[here]
                same[f] = other.name == alternatives[0].name
        return best, float(same.mean())

    def _without(self, effects: Sequence[Effect], by_time: bool) -> Predicted:
        """The rest of the fit, some of its effects taken out."""
        fit, whole = self.fit, self._whole(by_time)
        own = np.concatenate([fit.positions(effect) for effect in effects])
        u = whole.kept.freed(own)  # directions that nothing of the rest sees
        return replace(whole, u=u, r=whole.kept.without(own, fit.moving[own]).left)

    def _whole(self, by_time: bool) -> Predicted:
        """The fit as it is."""
        if by_time not in self._last:
            # By least squares, which is what predicts.
            linear = self.fit.linear
            kept = linear if linear.mixing is None else replace(linear, mixing=None)
            Q = kept.complement.at_readings[1]
            fold = _folds(self.stage.data.poses, by_time)
            each = (Fold.of(Q, fold == f) for f in range(int(fold.max()) + 1))
            none = np.zeros((Q.shape[-1], 0))
            left = kept.complement.left
            self._last[by_time] = Predicted(kept, tuple(each), none, self.fit.prior_weight, left)
        return self._last[by_time]

    @cached_property
    def _independent(self) -> CrossValidation:
        """The same of rows that err independently."""
        fit, mixing = self.fit, self.fit.mixing or Mixing((), 1.0)
        return replace(self, fit=fit.by_instrument(mixing(fit.r[..., None])[..., 0], mixing(fit.J)))


@dataclass(frozen=True, eq=False)
class Predicted:
    """Cross-validation residuals of a fit from which some effects are removed, or none.

    kept : LinearProblem, the fit; folds : tuple of Fold
    u : ndarray, shape (k, c), directions of the fit that they leave free
    r : ndarray, shape (N,), the residual then
    """

    kept: LinearProblem
    folds: tuple[Fold, ...]
    u: Array
    prior_weight: float
    r: Array

    def projected(self, rows: Array) -> Array:
        """Rows (N, ..) with the rest projected out."""
        Q, u = self.kept.basis, self.u
        seen = Q.T @ rows
        return np.asarray(rows - Q @ (seen - u @ (u.T @ seen)))

    @cached_property
    def left(self) -> Array:
        """Residuals (m, R) of poses predicted without their fold."""
        return self._predicted(self.r)[..., 0]

    def with_alternative(self, other: Alternative) -> tuple[Array, Array]:
        """Evidence for a cause from all but each fold, (F,), and residuals (m, R) predicted with it.

        With M what projects out the rest and K what predicts a fold F by the others, these say of
        columns X ``S = X^T M X - (M X)_F^T K (M X)_F``, of the residual alike.
        """
        m, R, k = other.rows.shape
        X = self.projected(self.kept.columns(other.rows))
        back, gains, left = self._predicted(X), np.zeros(len(self.folds)), self.left.copy()
        S, z = X.T @ X + np.diag((self.prior_weight / other.limits) ** 2), X.T @ self.r
        rows = int(np.count_nonzero(self.kept.fitted[1].any(axis=-1)))
        price = k * float(np.log(max(2, rows)))
        at_poses = X[: m * R].reshape(m, R, k)
        for f, fold in enumerate(self.folds):
            own, missed = stacked(at_poses[fold.here]), back[fold.here]
            told = z - own.T @ left[fold.here].ravel()
            b = np.linalg.lstsq(S - own.T @ stacked(missed), told, rcond=1e-12)[0]
            gains[f] = float(told @ b) / self.prior_weight**2 - price
            left[fold.here] -= missed @ b
        return gains, left

    def _predicted(self, rows: Array) -> Array:
        """What rows (N, ..) of the readings leave, (m, R, ..), predicted without their fold.

        ``(I - Q Q^T + W W^T)^-1`` by Woodbury, W the rows of the free directions in the fold.
        """
        m, R = self.kept.r.shape
        at_poses, free = rows[: m * R].reshape(m, R, -1), np.eye(self.u.shape[1])
        out = np.zeros(at_poses.shape)
        for fold in self.folds:
            W = fold.Q @ self.u
            back, left = fold.predicted(W), fold.predicted(stacked(at_poses[fold.here]))
            left = left - back @ np.linalg.solve(free + W.T @ back, W.T @ left)
            out[fold.here] = left.reshape(-1, R, out.shape[-1])
        return out


@dataclass(frozen=True, eq=False)
class Fold:
    """A fold of the cross-validation: poses that are left out together.

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

    def predicted(self, rows: Array) -> Array:
        """``(I - Q Q^T)^-1`` of rows (n, c): what they leave when the others predict them."""
        return np.asarray(rows + self.Q @ (self.inverse @ (self.Q.T @ rows)))


def _folds(poses: Poses, by_time: bool) -> IntArray:
    """Number of the fold of each pose, shape (m,)."""
    if by_time:
        return blocks_of_time(poses, _STRETCHES)
    count = int(poses.configuration.max()) + 1
    drawn = np.random.default_rng(0).permutation(count) % min(_FOLDS, count)
    return np.asarray(drawn[poses.configuration])


def _rms(stage: Stage, fit: Fit, errors: Array) -> float:
    """3-D root mean square per point, m, of whitened errors (m, R), as of :func:`squared_errors`."""
    lengths = stage.model.readout.channels.lengths
    counted = stage.data.seen & ~stage.dropped[:, None] & lengths.any(axis=-1)
    weights = stage.weights * np.maximum(fit.weight, 1e-9)[:, None, None, None]
    points = unwhitened(weights, stage.data.in_place(errors)) * lengths
    return float(np.sqrt((points[counted] ** 2).sum() / max(1, counted.sum())))


@dataclass(frozen=True)
class Reselection:
    """Errors at what was left out, without and with what was found, 3-D RMS, m.

    again : dict, key of an entry -> share of the folds without which it, or its equal, comes again
    """

    before: float
    after: float
    again: dict[str, float]


def reselected(
    stage: Stage, outcome: Outcome, named: Sequence[Named], by_time: bool = False
) -> Reselection | None:
    """Both errors, None where nothing was found.

    stage : to first order, that of the outcome; by_time : whether stretches of time are left out
    """
    if not outcome.active:
        return None
    crossed, active = CrossValidation(stage, outcome.fit), outcome.active
    whole = crossed.ledger([c.effect for c in active], by_time)
    square, again = whole.rms_with**2, {}
    for one in named:
        member = one.entry.candidate
        place = [c.effect for c in with_curves(member, active)]
        told = crossed.ledger(place, by_time, list(_alternatives(outcome, one)))
        square += max(told.rms_with**2 - whole.rms_with**2, 0.0)
        again[member.key] = told.again
    return Reselection(whole.rms_without, float(np.sqrt(square)), again)


def _alternatives(outcome: Outcome, named: Named) -> Iterator[Alternative]:
    """What might have been found in a cause's place; itself first."""
    entry, view = named.entry, outcome.view
    alike = {c.key.partition(" as ")[0] for c, _ in named.members}
    first = entry.candidate.key

    def name(key: str) -> str:
        return first if key.partition(" as ")[0] in alike else key

    least = entry.rivals[0][1] - CLOSE
    rivals = [c for c, gain in entry.rivals if c.named and gain > least]
    for c in dict.fromkeys([entry.candidate, *rivals]):
        yield Alternative(name(c.key), view.rows(view.where[c.key]), c.limits)
    for rows, limits in outcome.lineup.other_tunings(view, entry.candidate):
        yield Alternative(first, rows, limits)
