"""The contest in full: about the exact fit, and anew while noise and outliers are judged anew."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.arrays import Array, Mask
from calib.diagnosis.candidates import Candidate
from calib.diagnosis.contest import Outcome, contest, plausible
from calib.diagnosis.screen import refuted
from calib.diagnosis.stage import Fit, Stage
from calib.diagnosis.view import lineup
from calib.effects.tuned import Tuned
from calib.errors import Unsolvable
from calib.identification.noise_level import (
    REPLICATES,
    Growth,
    growth_with_range,
    replicate_spreads,
)
from calib.identification.outliers import judge, threshold
from calib.poses import Measurements
from calib.poses.moves import visits

_GROSS = 10.0  # times the mean square of a typical group
_MOST_PASSES = 2  # contests, while outliers are judged anew


@dataclass(frozen=True, eq=False)
class Searched:
    """Where the contests ended.

    stage : Stage, what was fitted; linear : the same to first order about its last fit
    factor : float, actual over stated noise by readings that were repeated
    growth : Growth, of the noise with range, None where the residual shows none
    statistic : ndarray, shape (m,), of each pose under that fit, an outlier's above ``limit``
    """

    stage: Stage
    linear: Stage
    outcome: Outcome
    factor: float
    growth: Growth | None
    statistic: Array
    limit: float


def searched(stage: Stage, suspects: Sequence[Candidate]) -> Searched:
    """Ask all suspects for what the model leaves.

    stage : Stage, weighed by the noise as stated; what it drops stays out
    """
    stated, data, waiting = stage.weights, stage.data, stage.dropped
    stage, factor = _as_repeated(stage, stated)
    linear = stage.about(stage.fit(()), [c.effect for c in suspects])
    asked = lineup(linear, suspects)
    outcome = contest(linear, asked)
    grows = growth_with_range(data, outcome.fit.r)
    if grows is not None:
        stage, factor = _as_repeated(stage, stated / grows.relative[..., None, None])
        linear = replace(linear, weights=stage.weights)
        outcome = contest(linear, asked)
    statistic, limit = np.zeros(len(data)), np.inf
    for _ in range(_MOST_PASSES):
        try:
            fit = stage.exact(outcome.fit)
        except Unsolvable:  # to first order an arm may be so soft that it does not stand
            outcome = plausible(linear, outcome)
            fit = stage.exact(outcome.fit)
        out, statistic, limit = _outliers(stage, fit)
        out |= waiting
        if not stage.robust and np.array_equal(out, stage.dropped):
            break
        stage = replace(stage, dropped=out, robust=False)
        linear = stage.about(fit, [c.effect for c in suspects])
        active = [_tuned_as(c, fit) for c in outcome.active]
        asked = lineup(linear, suspects, asked.grids)
        outcome = contest(linear, asked, active, outcome.proved)
    return Searched(stage, linear, outcome, factor, grows, statistic, limit)


def _as_repeated(stage: Stage, stated: Array) -> tuple[Stage, float]:
    """The stage weighed by what repeated readings say of the noise, and actual over stated noise."""
    factor = replicate_factor(stage.data, stated)
    return replace(stage, weights=stated / factor), factor


def replicate_factor(data: Measurements, weights: Array) -> float:
    """Actual over stated noise by readings repeated without a move; one where they agree.

    One too where they are few. Readings between which the arm moved hold its repeatability as well.
    Groups with a gross error do not count: whatever is no noise stands out among the others.
    """
    _, group = np.unique(
        np.column_stack([data.poses.repeated, visits(data.poses)]), axis=0, return_inverse=True
    )
    spreads = replicate_spreads(data, weights, group.reshape(-1))
    spreads = spreads[spreads[:, 1] > 0]
    if not len(spreads):
        return 1.0
    squares = spreads[:, 0] / spreads[:, 1]
    typical = np.quantile(squares, 0.25, method="lower")
    spread, dof = spreads[squares <= _GROSS * typical].sum(axis=0)
    if dof < REPLICATES or not spread:  # without any spread they are copies
        return 1.0
    return float(np.sqrt(spread / dof)) if refuted(float(spread), int(dof)) else 1.0


def _tuned_as(candidate: Candidate, fit: Fit) -> Candidate:
    """A candidate with the tuning that it has in a fit."""
    if not isinstance(candidate.effect, Tuned):
        return candidate
    return candidate.as_tuned(float(fit.values[fit.positions(candidate.effect)[0]]))


def _outliers(stage: Stage, fit: Fit) -> tuple[Mask, Array, float]:
    """Poses that the model with all its effects does not explain."""
    plain = stage.statistics(fit)
    statistic = plain / stage.lack_alone(fit, plain)
    limit = threshold(statistic, fit.r.shape[-1])
    return judge(statistic, limit), statistic, limit
