"""The search for values and outliers: fit, judge, and fit again until the judgement stands."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.arrays import Array, Mask
from calib.errors import CalibError
from calib.identification.alone import lack_alone
from calib.identification.estimators import (
    Estimator,
    choose_directions,
    rigid_directions,
    unspent,
)
from calib.identification.initial import strayed
from calib.identification.outliers import (
    independent_share,
    judge,
    next_outlier,
    pose_statistics,
    small_set,
    threshold,
    wrongly_out,
)
from calib.model.covariance import Identifiable, Unidentifiable
from calib.observations import Observation
from calib.solver import Minimum

# Of a fit that gross errors bend only the size of what it leaves is told: five digits of it.
_TOLD = 30
_ROUNDS = 12  # times that outliers are judged anew
_STRAYED = "these poses tell so little of it that its estimate ran away"


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


def search(
    estimator: Estimator, observation: Observation, start: Array, kept: Mask | None = None
) -> Found:
    """Fit without the outliers, each round judged by the fit before.

    kept : ndarray of bool, shape (m,), poses that an earlier search kept: this one goes on from there

    With something elastic in the model, gross outliers are first looked for under the rigid part
    alone: a bent arm can follow a wrong point a long way. What only bent is taken back after.

    Raises CalibError where the estimator lacks the readings that it needs.
    """
    choice = _Choice.at(observation, start)
    if estimator.dof(observation, choice.span) < 0:
        raise CalibError(
            "too few readings at equal joints for differences: each configuration must be measured "
            "free and loaded, and the model must hold something elastic"
        )
    if kept is None:
        kept = _stiffly_kept(estimator, observation, start, choice.span)
    best, choice = _fit(estimator, observation.only(kept), start, start, choice)
    first = best if kept.all() else None
    fresh, statistics, limit = _judged(estimator, observation, best.values, kept, choice.span)
    for _ in range(_ROUNDS):
        if np.array_equal(fresh, kept):
            break
        kept = fresh
        counted = observation.only(kept)
        choice = _Choice.at(counted, start)
        best, choice = _fit(estimator, counted, start, best.values, choice)
        fresh, statistics, limit = _judged(estimator, observation, best.values, kept, choice.span)
    if first is None:
        first = estimator.fit(observation, best.values, choice.span, _TOLD)
    counted, regular = observation.only(kept), False
    for _ in range(_ROUNDS):
        at_end = choice.anew(counted, best.values)
        regular = at_end.span.shape[1] >= choice.span.shape[1]
        if regular:
            break
        # The start was where more is told: a marker on an axis tells less than one beside it.
        best, choice = _fit(estimator, counted, start, start, at_end)
        fresh, statistics, limit = _judged(estimator, observation, best.values, kept, choice.span)
    undecided = fresh != kept
    return Found(first, best, kept, statistics, limit, undecided, choice.told, choice.span, regular)


@dataclass(frozen=True, eq=False)
class _Choice:
    """What is estimated.

    among : ndarray, shape (p, n), directions to choose from; told : Identifiable, what was chosen
    strayed : tuple of Unidentifiable, that are not among them, for a fit lost them
    """

    among: Array
    chosen: Identifiable
    strayed: tuple[Unidentifiable, ...] = ()

    @classmethod
    def at(cls, observation: Observation, values: Array) -> _Choice:
        """What the data determine at some values."""
        among = observation.span()
        return cls(among, choose_directions(observation, values, among))

    def anew(self, observation: Observation, values: Array) -> _Choice:
        """The same at other values."""
        return replace(self, chosen=choose_directions(observation, values, self.among))

    def without(self, observation: Observation, values: Array, strayed: Mask) -> _Choice:
        """The same without the values (p,) that a fit lost."""
        names = tuple(observation.model.parameters[i].id for i in np.flatnonzero(strayed))
        among = self.among[:, np.abs(self.among[strayed]).sum(axis=0) == 0.0]
        lost = Unidentifiable(names, _STRAYED)
        return replace(self, among=among, strayed=(*self.strayed, lost)).anew(observation, values)

    @property
    def span(self) -> Array:
        return self.among[:, self.chosen.kept]

    @property
    def told(self) -> Identifiable:
        return replace(self.chosen, unidentifiable=(*self.chosen.unidentifiable, *self.strayed))


def _fit(
    estimator: Estimator, observation: Observation, start: Array, begun: Array, choice: _Choice
) -> tuple[Minimum, _Choice]:
    """The fit from ``begun`` (p,), and what it estimates: what strays from ``start`` stays there."""

    def lost(values: Array) -> Mask:
        return strayed(observation.model, observation.data, start, values)

    best = estimator.fit(observation, begun, choice.span)
    while (out := lost(best.values)).any():
        choice = choice.without(observation, start, out)
        best = estimator.fit(observation, start, choice.span, _TOLD)
        if not lost(best.values).any():
            best = estimator.fit(observation, best.values, choice.span)
    return best, choice


def _stiffly_kept(
    estimator: Estimator, observation: Observation, start: Array, span: Array
) -> Mask:
    """Poses to keep by a fit in which nothing yields, all where nothing can."""
    every = np.ones(len(observation.data), dtype=bool)
    rigid = rigid_directions(observation.model, span)
    if not 0 < rigid.shape[1] < span.shape[1]:
        return every
    stiff = estimator.fit(observation, start, rigid)
    return _judged(estimator, observation, stiff.values, every, rigid)[0]


def _judged(
    estimator: Estimator, observation: Observation, values: Array, kept: Mask, span: Array
) -> tuple[Mask, Array, float]:
    """Poses to keep, the statistic of every pose, and its limit, under the fit to those kept."""
    judged = estimator.judged(observation, values, span, kept)
    known = observation.beside(values)
    statistics, rows = pose_statistics(judged.r, judged.J, kept, judged.span, known[1])
    poses = observation.data.poses
    lack = lack_alone(poses, judged.r, judged.J, kept, judged.span, known, statistics)
    statistics = statistics / lack
    if small_set(len(kept)):
        cost = float((judged.r[kept] ** 2).sum())
        dof = estimator.dof(observation.only(kept), span)
        dof -= round(unspent(observation.only(kept), values, span))
        fresh = kept.copy()
        tested = statistics, rows, kept, cost, dof, independent_share(judged.r, kept)
        back = wrongly_out(*tested)
        worst = next_outlier(*tested) if back is None else None
        for pose, belongs in ((back, True), (worst, False)):
            if pose is not None:
                fresh[pose] = belongs
        limit = float(statistics[fresh].max(initial=0.0))
        return fresh, statistics, limit
    limit = threshold(statistics, judged.r.shape[-1])
    return ~judge(statistics, limit), statistics, limit
