"""Detection limits: sizes at which causes are found, and what undetected ones leave."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from calib.arrays import Array
from calib.diagnosis.candidates import Candidate
from calib.diagnosis.columns import columns_at
from calib.diagnosis.regression import CandidateColumns
from calib.diagnosis.search import Outcome
from calib.diagnosis.stage import Fit, Stage
from calib.effects.protocol import Parameter
from calib.inference.evidence import VISIBLE, visible_directions
from calib.model.covariance import working_points
from calib.poses import Poses

_ROUNDS = 20  # of a fixed point that halves its error in each

POWER = 0.9
ALPHA = 0.01
"""Probability, over all candidates together, of a score test beyond the limit by chance."""


def needed_beyond(limit: float, directions: int, power: float = POWER) -> float:
    """Noncentrality at which a score in so many directions exceeds a limit with this probability."""
    from scipy.special import chndtrinc

    return float(chndtrinc(limit, directions, 1.0 - power))


def detection(limit: float, directions: int, noncentrality: Array | float) -> Array:
    """Probability that a score exceeds a limit: the upper tail of noncentral chi-square.

    noncentrality : ndarray of any shape, or a number; the result has its shape
    """
    from scipy.special import chndtr

    return np.asarray(1.0 - chndtr(limit, directions, noncentrality))


def entry_limit(directions: int, choices: float, alpha: float) -> float:
    """Score beyond which a cause is believed, of so many that are asked.

    The stricter of a chi-square test at level alpha over all that are asked (Bonferroni), and of what
    the selection asks: a score t in k directions gains ``t - k - k log(t / k)`` at the amplitude that
    is best where all directions show alike, and must pay ``2 log(choices)``.
    """
    from scipy.special import chdtri

    k, price = directions, 2.0 * np.log(choices)
    t = k + price
    for _ in range(_ROUNDS):
        t = k + price + k * np.log(t / k)
    return max(float(chdtri(k, alpha / choices)), float(t))


@dataclass(frozen=True, eq=False)
class Detectable:
    """Detection limits of a cause of k parameters, for given readings.

    directions : int, in which it can be seen; none where it is hidden
    share : ndarray, shape (k,), of each parameter's signal that is left beside the model
    smallest : ndarray, shape (k,), SI, size of each alone that is found with probability ``POWER``;
        infinite where no size would do
    limit, needed : float, score beyond which it is believed, and noncentrality that reaches it
    """

    directions: int
    share: Array
    smallest: Array
    limit: float
    needed: float

    def found(self, times: Array) -> Array:
        """Probability that the cause is found at multiples of its smallest size, shape (k,)."""
        return detection(self.limit, self.directions, self.needed * np.asarray(times) ** 2)


def detectable(S: Array, lengths: Array, choices: float, alpha: float) -> Detectable:
    """What readings would show of a cause of k columns, of so many that are asked.

    S : ndarray, shape (k, k), products of its columns with everything modelled projected out
    lengths : ndarray, shape (k,), of the columns before
    """
    left = np.sqrt(np.maximum(np.diag(S), 0.0))
    share = left / np.where(lengths > 0.0, lengths, 1.0)
    nowhere, visible = np.full(len(S), np.inf), share > VISIBLE
    directions = int(visible_directions(S, lengths)[1].sum())
    if not directions or not visible.any():  # what is left of a combination alone is rounding
        return Detectable(0, share, nowhere, np.inf, np.inf)
    limit = entry_limit(directions, choices, alpha)
    needed = needed_beyond(limit, directions)
    smallest = np.divide(np.sqrt(needed), left, out=nowhere, where=visible)
    return Detectable(directions, share, smallest, limit, needed)


_NEVER = 1e3  # plausible sizes: what must be larger to be found is not visible


@dataclass(frozen=True)
class DetectionLimit:
    """The size (SI) that an effect must have to be found; infinite where no size would do.

    left : float, m, 3-D RMS that it leaves per point where accuracy counts, at that size or at a
        plausible one where that is less, once the model has taken up what it can of it
    """

    effect: str
    where: str
    smallest: float
    unit: str
    scale: float
    left: float


@dataclass(frozen=True, eq=False)
class _HiddenError:
    """One parameter at one size: derivatives (N,) of all independent rows."""

    candidate: Candidate
    number: int
    parameter: Parameter
    smallest: float
    rows: Array

    @property
    def size(self) -> float:
        return min(self.smallest, self.parameter.size)


def detection_limits(
    stage: Stage,
    outcome: Outcome,
    entered: Collection[str],
    targets: tuple[Poses, Array],
) -> tuple[DetectionLimit, ...]:
    """What every cause that is not in would have to be to be found, nine times in ten.

    entered : keys of those that are
    targets : Poses, and weights (t,); an effect that depends on more than joints and load, such as
        drift, is judged at the readings instead
    """
    state = outcome.judged
    errors = [
        _error(outcome, own)
        for own in state.candidates
        if own.candidate.named and not own.candidate.echo and own.candidate.key not in entered
    ]
    fit = outcome.fit
    by_joints = [e for e in errors if not e.candidate.effect.uses]
    others = [e for e in errors if e.candidate.effect.uses]
    poses = stage.data.poses
    left = {
        **_left(fit, by_joints, *targets),
        **_left(fit, others, poses, np.where(stage.dropped, 0.0, 1.0)),
    }
    return tuple(
        DetectionLimit(
            e.candidate.effect.kind,
            e.candidate.effect.where,
            e.smallest,
            e.parameter.unit,
            e.parameter.scale,
            left[e.candidate.key],
        )
        for e in errors
    )


def _error(outcome: Outcome, own: CandidateColumns) -> _HiddenError:
    """The parameter of a cause that is found best, against the size of such errors."""
    candidate, state = own.candidate, outcome.judged
    beside, asked = state.conditional, state.problem.candidates
    S, lengths = beside.squares(own.columns[None])[0], beside.products.lengths(own.columns)
    choices = asked.asked * candidate.choices
    sizes = detectable(S, lengths, choices, ALPHA).smallest.tolist()  # in plausible ones
    number = int(np.argmin(sizes))
    parameter = candidate.amounts[number]
    size = sizes[number] * parameter.size if sizes[number] < _NEVER else np.inf
    fit = outcome.fit
    rows = fit.linear.columns(asked.rows_of(candidate)[..., [number]])[:, 0]
    return _HiddenError(candidate, number, parameter, size, rows)


def _left(
    fit: Fit, errors: Sequence[_HiddenError], poses: Poses, weights: Array
) -> dict[str, float]:
    """RMS (m) that each leaves at poses: ``X_t s - J_t (J^+ X s)``, by the candidate's key."""
    if not errors:
        return {}
    _, J = fit.linear.independent
    X = np.stack([e.rows * e.size for e in errors], axis=1)
    taken = fit.span @ np.linalg.lstsq(J @ fit.span, X, rcond=None)[0]
    effects = [e.candidate.effect for e in errors]
    own, there = columns_at(working_points(fit.model), fit.values, poses, effects)
    moved = np.stack(
        [columns[..., e.number] * e.size for columns, e in zip(there, errors, strict=True)], axis=-1
    )
    squares = ((moved - own @ taken) ** 2).sum(axis=2).mean(axis=1)
    rms = np.sqrt(weights @ squares / weights.sum())
    return dict(zip((e.candidate.key for e in errors), rms.tolist(), strict=True))
