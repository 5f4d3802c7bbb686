"""Detection limits: sizes at which causes are found, and what undetected ones leave."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from calib.arrays import Array, IntArray
from calib.diagnosis.candidates import Candidate
from calib.diagnosis.linear import linearised
from calib.diagnosis.screen import Field
from calib.diagnosis.search import Outcome
from calib.diagnosis.stage import Fit, Stage
from calib.effects.protocol import Parameter
from calib.evidence import VISIBLE
from calib.model.covariance import working_points
from calib.poses import Poses

POWER = 0.9
ALPHA = 0.01
"""Probability, over all candidates together, of a score test beyond the limit by chance."""


@lru_cache(maxsize=256)
def needed_beyond(limit: float, directions: int, power: float = POWER) -> float:
    """Noncentrality at which a score in so many directions exceeds a limit with this probability."""
    from scipy.optimize import brentq

    return float(brentq(lambda x: float(detection(limit, directions, x)) - power, 1e-6, 1e6))


def detection(limit: float, directions: int, noncentrality: Array | float) -> Array:
    """Probability that a score exceeds a limit: the upper tail of noncentral chi-square.

    noncentrality : ndarray of any shape, or a number; the result has its shape
    """
    from scipy.special import chndtr

    return np.asarray(1.0 - chndtr(limit, directions, noncentrality))


def entry_limit(directions: int, rows: int, asked: int, alpha: float) -> float:
    """Score beyond which a cause is believed, of so many asked at readings with so many rows.

    The stricter of a chi-square test at level alpha over all that are asked (Bonferroni), and of
    Schwarz's price of the directions with twice the logarithm of the choice.
    """
    from scipy.special import chdtri

    price = directions * np.log(rows) + 2.0 * np.log(asked)
    return max(float(chdtri(directions, alpha / asked)), float(price))


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


def detectable(field: Field, columns: IntArray, asked: int, alpha: float) -> Detectable:
    """What readings would show of the cause with these columns, of so many asked."""
    lengths, whole = np.linalg.norm(field.projected(columns), axis=0), field.lengths[columns]
    share = lengths / np.where(whole > 0.0, whole, 1.0)
    nowhere, visible = np.full(len(columns), np.inf), share > VISIBLE
    directions = field.directions(columns).shape[1]
    if not directions or not visible.any():  # what is left of a combination alone is rounding
        return Detectable(0, share, nowhere, np.inf, np.inf)
    limit = entry_limit(directions, field.rows, asked, alpha)
    needed = needed_beyond(limit, directions)
    smallest = np.divide(np.sqrt(needed), lengths, out=nowhere, where=visible)
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
    errors = [
        _error(outcome, candidate)
        for candidate in outcome.suspects
        if candidate.named and not candidate.echo and candidate.key not in entered
    ]
    fit = outcome.view.fit
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


def _error(outcome: Outcome, candidate: Candidate) -> _HiddenError:
    """The parameter of a cause that is found best, against the size of such errors."""
    columns, parameters = outcome.view.where[candidate.key], candidate.amounts
    asked = len(outcome.suspects) * candidate.tried
    sizes = detectable(outcome.view.complement, columns, asked, ALPHA).smallest.tolist()
    number = min(range(len(sizes)), key=lambda k: sizes[k] / parameters[k].size)
    size, parameter = sizes[number], parameters[number]
    size = size if size < _NEVER * parameter.size else np.inf
    rows = outcome.view.columns[:, columns[number]]
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
    model = working_points(fit.model)
    there = linearised(model, fit.values, poses, [e.candidate.effect for e in errors])
    own = np.concatenate([there.of(effect) for effect in there.effects], axis=-1)
    moved = np.stack([_column(there.of(e.candidate.effect), e) for e in errors], axis=-1)
    squares = ((moved - own @ taken) ** 2).sum(axis=2).mean(axis=1)
    rms = np.sqrt(weights @ squares / weights.sum())
    return dict(zip((e.candidate.key for e in errors), rms.tolist(), strict=True))


def _column(columns: Array, error: _HiddenError) -> Array:
    """Displacements (t, C, 3), m, by an effect's parameters (t, C, 3, k) at the error's size."""
    first = columns.shape[-1] - len(error.candidate.amounts)  # a tuning is no size
    return np.asarray(columns[..., first + error.number] * error.size)
