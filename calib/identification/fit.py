"""The fit to readings: values, the directions that the readings determine, and the poses that belong.

A fit judges every pose, and what it rejects stays out of the next, until the judgement stands.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np

from calib.arrays import Array, Mask
from calib.effects.base import Base
from calib.effects.protocol import ElasticEffect, LoadEffect
from calib.effects.tool import Tool
from calib.identification.estimators import Directions, Method, alternate
from calib.identification.outliers import Judgement, judged
from calib.identification.start import strayed
from calib.linear import LinearProblem
from calib.model import Model
from calib.model.covariance import Identifiable
from calib.observations import Observation, points_of
from calib.solver import Minimum, levenberg_marquardt

# Of a fit that gross errors bend only the size of what it leaves is stated: five digits of it.
_FEW_DIGITS = 30
_ROUNDS = 12  # times that outliers are judged anew
# A valley along which poses of narrow joint ranges tell little takes hundreds.
_MOST_ITERATIONS = 400


@dataclass(frozen=True, eq=False)
class Fit:
    """Where a search ended.

    method : as of :func:`calib.identify`; observation : Observation, of all poses
    first : Minimum over every pose; best : Minimum over the poses kept
    kept : ndarray of bool, shape (m,); statistics : ndarray, shape (m,), under the last fit, judged by
        ``limit``
    unsettled : ndarray of bool, shape (m,), poses of which the last fit says other than was fitted
    readings : LinearProblem, of all poses, by which they were judged
    left : what the kept poses leave of them, in the noise as stated, and its degrees of freedom. What
        is known beside the readings counts as they do, but for the sizes of errors
    choice : Identifiable, what the readings determine; span : ndarray, shape (p, k), the directions
        that were estimated: more of them where the sizes of errors hold what the readings leave open
    regular : whether the kept poses still determine them where the search ended
    """

    method: Method
    observation: Observation
    first: Minimum
    best: Minimum
    kept: Mask
    statistics: Array
    limit: float
    unsettled: Mask
    readings: LinearProblem
    left: tuple[float, int]
    choice: Identifiable
    span: Array
    regular: bool

    @property
    def model(self) -> Model:
        """As it was fitted."""
        return self.observation.model

    @property
    def values(self) -> Array:
        """The estimate, shape (p,), SI."""
        return self.best.values

    @cached_property
    def counted(self) -> Observation:
        """The observation of the poses that were kept."""
        return self.observation.only(self.kept)


def search(method: Method, observation: Observation, start: Array, kept: Mask | None = None) -> Fit:
    """Fit without the outliers, each round judged by the fit before.

    start : ndarray, shape (p,), SI
    kept : ndarray of bool, shape (m,), poses that an earlier search kept: this one goes on from there

    With something elastic in the model, gross outliers are first looked for under the rigid part
    alone: a bent arm can follow a wrong point a long way. What only bent is taken back after.
    """
    own = _Search(method, observation, start)
    choice = Directions.at(observation, start)
    if kept is None:
        kept = own.rigidly_kept(choice.span)
    best, choice = own.fit(kept, start, choice)
    first = best if kept.all() else None
    seen = own.judged(best.values, kept, choice.span)
    for _ in range(_ROUNDS):
        if np.array_equal(seen.said.kept, kept):
            break
        kept = seen.said.kept
        best, choice = own.fit(kept, best.values, Directions.at(observation.only(kept), start))
        seen = own.judged(best.values, kept, choice.span)
    if first is None:
        first = _minimum(method, observation, best.values, choice.span, _FEW_DIGITS)
    regular = False
    for _ in range(_ROUNDS):
        at_end = choice.anew(observation.only(kept), best.values)
        regular = at_end.span.shape[1] >= choice.span.shape[1]
        if regular:
            break
        # The start was where more is told: a marker on an axis tells less than one beside it.
        best, choice = own.fit(kept, start, at_end)
        seen = own.judged(best.values, kept, choice.span)
    return Fit(
        method,
        observation,
        first,
        best,
        kept,
        seen.said.statistics,
        seen.said.limit,
        seen.said.kept != kept,
        seen.readings,
        seen.left,
        choice.identifiable,
        choice.span,
        regular,
    )


class _Judged(NamedTuple):
    """Readings to first order, what those kept leave and its freedom, and the poses to keep."""

    readings: LinearProblem
    left: tuple[float, int]
    said: Judgement


@dataclass(frozen=True, eq=False)
class _Search:
    """What all fits of a search share; start : ndarray, shape (p,), SI."""

    method: Method
    observation: Observation
    start: Array

    def fit(self, kept: Mask, begun: Array, choice: Directions) -> tuple[Minimum, Directions]:
        """The fit from ``begun`` (p,), and what it estimates: what diverges stays at the start."""
        counted = self.observation.only(kept)
        lost = partial(strayed, counted.model, counted.data, self.start)
        best = _minimum(self.method, counted, begun, choice.span)
        while (out := lost(best.values)).any():
            choice = choice.without(counted, self.start, out)
            best = _minimum(self.method, counted, self.start, choice.span, _FEW_DIGITS)
            if not lost(best.values).any():
                best = _minimum(self.method, counted, best.values, choice.span)
        return best, choice

    def rigidly_kept(self, span: Array) -> Mask:
        """Poses to keep by a fit in which nothing yields, all where nothing can."""
        every = np.ones(len(self.observation.data), dtype=bool)
        rigid = _rigid_directions(self.observation.model, span)
        if not 0 < rigid.shape[1] < span.shape[1]:
            return every
        stiff = _minimum(self.method, self.observation, self.start, rigid)
        return self.judged(stiff.values, every, rigid).said.kept

    def judged(self, values: Array, kept: Mask, span: Array) -> _Judged:
        """What the fit to the poses kept leaves, and what it says of every pose."""
        observation = self.observation
        readings = _by_instrument(observation, values, span, kept)
        rows, own = math.prod(observation.weights.shape[-3:-1]), of_poses(readings, kept)
        known = len(own.off) - observation.model.prior_rows
        left = float((own.r**2).sum()) + float((own.off[:known] ** 2).sum())
        dof = _freedom(own, int(observation.only(kept).numbers.sum()), known)
        said = judged(observation.data, readings, kept, rows, dof)
        return _Judged(readings, (left, dof), said)


def of_poses(readings: LinearProblem, kept: Mask) -> LinearProblem:
    """The readings of some poses (m,), the rows of others zero."""
    own = kept[:, None]
    return replace(readings, r=readings.r * own, J=readings.J * own[..., None])


def _minimum(
    method: Method,
    observation: Observation,
    start: Array,
    span: Array,
    most: int = _MOST_ITERATIONS,
) -> Minimum:
    """Least-squares values, moving along ``span`` (p, k), in at most so many iterations."""
    if method == "joint":
        return levenberg_marquardt(observation.flat, start, span, most)
    placement = np.abs(span[observation.model.where(Base, Tool)]).sum(axis=0) > 0.0
    return alternate(observation.flat, start, span[:, placement], span[:, ~placement])


def _rigid_directions(model: Model, span: Array) -> Array:
    """Those directions, columns of span (p, k), that move nothing elastic."""
    soft = model.where(ElasticEffect, LoadEffect)
    return np.asarray(span[:, np.abs(span[soft]).sum(axis=0) == 0.0])


def _by_instrument(
    observation: Observation, values: Array, span: Array, kept: Mask
) -> LinearProblem:
    """The readings to first order, as if nothing but the instrument erred: poses are judged by them.

    At the minimum of the readings themselves, from which another weighting keeps the estimate:
    elsewhere residuals are longer than their spread says, and right poses would stand out.

    values : ndarray, shape (p,), SI; span : ndarray, shape (p, k), directions that were estimated
    kept : ndarray of bool, shape (m,), the poses that were fitted
    """
    points = replace(points_of(observation), scatter=None)
    if not observation.efficient or observation.weighing is not None:
        values = levenberg_marquardt(points.only(kept).flat, values, span).values
    return points.linear(values, span)


def _freedom(readings: LinearProblem, numbers: int, known: int) -> int:
    """Degrees of freedom of the readings' residuals; negative where the readings do not suffice.

    numbers : int, that count; known : int, first rows beside the readings that count as these do. The
    others are of sizes, and count less what they determine of the values.
    """
    sizes = readings.held[known:]
    dof = numbers + known - int(readings.span.shape[1])
    return (
        dof + round(float(np.trace(sizes @ readings.held_gains[known:].T))) if len(sizes) else dof
    )
