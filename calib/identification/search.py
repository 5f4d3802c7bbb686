"""The search for values and outliers: fit, judge, and fit again until the judgement stands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, Mask
from calib.errors import CalibError
from calib.identification.estimators import (
    Estimator,
    choose_directions,
    rigid_directions,
    unspent,
)
from calib.identification.initial import in_room
from calib.identification.outliers import (
    judge,
    next_outlier,
    pose_statistics,
    small_set,
    threshold,
    wrongly_out,
)
from calib.model.covariance import Identifiable
from calib.observations import Observation
from calib.solver import Minimum

# Of a fit that gross errors bend only the size of what it leaves is told: five digits of it.
_TOLD = 30
_ROUNDS = 12  # times that outliers are judged anew
_LOUDER = 10.0  # that the noise is taken, where a place has left the room


@dataclass(frozen=True, eq=False)
class Found:
    """Where a search ended.

    first : Minimum over every pose; best : Minimum over the poses kept
    kept : ndarray of bool, shape (m,); statistics : ndarray, shape (m,), under the last fit, judged by
        ``limit``
    undecided : ndarray of bool, shape (m,), poses of which the last fit says other than was fitted
    choice : Identifiable, what the kept poses determine; span : ndarray, shape (p, k), its directions
    regular : whether they still determine it where the search ended
    """

    first: Minimum
    best: Minimum
    kept: Mask
    statistics: Array
    limit: float
    undecided: Mask
    choice: Identifiable
    span: Array
    regular: bool


def search(estimator: Estimator, observation: Observation, start: Array) -> Found:
    """Fit without the outliers, each round judged by the fit before.

    With something elastic in the model, gross outliers are first looked for under the rigid part
    alone: a bent arm can follow a wrong point a long way. What only bent is taken back after.

    Raises CalibError where the estimator lacks the readings that it needs.
    """
    every = np.ones(len(observation.data), dtype=bool)
    choice = choose_directions(observation, start)
    span = observation.span()[:, choice.kept]
    if estimator.dof(observation, span) < 0:
        raise CalibError(
            "too few readings at equal joints for differences: each configuration must be measured "
            "free and loaded, and the model must hold something elastic"
        )
    rigid = rigid_directions(observation.model, span)
    kept = every
    if 0 < rigid.shape[1] < span.shape[1]:
        stiff = estimator.fit(observation, start, rigid)
        kept, _, _ = _judged(estimator, observation, stiff.values, every, rigid)
    best = estimator.fit(observation.only(kept), start, span)
    first = best if kept.all() else None
    fresh, statistics, limit = _judged(estimator, observation, best.values, kept, span)
    for _ in range(_ROUNDS):
        if np.array_equal(fresh, kept):
            break
        kept = fresh
        choice = choose_directions(observation.only(kept), start)
        span = observation.span()[:, choice.kept]
        best = estimator.fit(observation.only(kept), best.values, span)
        fresh, statistics, limit = _judged(estimator, observation, best.values, kept, span)
    if first is None:
        first = estimator.fit(observation, best.values, span, _TOLD)
    counted, loud, regular = observation.only(kept), 1.0, False
    for _ in range(_ROUNDS):
        at_end = choose_directions(counted, best.values)
        stays = in_room(observation.model, observation.data, start, best.values)
        regular = stays and at_end.rank >= choice.rank
        if regular:
            break
        if stays:  # the start was where more is told: a marker on an axis tells less than beside it
            choice = at_end
        else:  # by the noise as it is the data do not tell what they seem to
            loud *= _LOUDER
            choice = choose_directions(counted, start, loud=loud)
        span = observation.span()[:, choice.kept]
        best = estimator.fit(counted, start, span)
        fresh, statistics, limit = _judged(estimator, observation, best.values, kept, span)
    return Found(first, best, kept, statistics, limit, fresh != kept, choice, span, regular)


def _judged(
    estimator: Estimator, observation: Observation, values: Array, kept: Mask, span: Array
) -> tuple[Mask, Array, float]:
    """Poses to keep, the statistic of every pose, and its limit, under the fit to those kept."""
    judged = estimator.judged(observation, values, span, kept)
    held = observation.beside(values)[1]
    statistics, rows = pose_statistics(judged.r, judged.J, kept, judged.span, held)
    if small_set(len(kept)):
        cost = float((judged.r[kept] ** 2).sum())
        dof = estimator.dof(observation.only(kept), span)
        dof -= round(unspent(observation.only(kept), values, span))
        fresh = kept.copy()
        back = wrongly_out(statistics, rows, kept, cost, dof)
        worst = next_outlier(statistics, rows, kept, cost, dof) if back is None else None
        for pose, belongs in ((back, True), (worst, False)):
            if pose is not None:
                fresh[pose] = belongs
        limit = float(statistics[fresh].max(initial=0.0))
        return fresh, statistics, limit
    limit = threshold(statistics, judged.r.shape[-1])
    return ~judge(statistics, limit), statistics, limit
