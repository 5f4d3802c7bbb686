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
from calib.identification.start import placed, room
from calib.linear import LinearProblem
from calib.model import Model
from calib.model.covariance import Identifiable
from calib.observations import Observation, points_of
from calib.poses import Measurements
from calib.solver import Minimum, levenberg_marquardt

# Of a fit that gross errors bend only the size of what it leaves is stated: five digits of it.
_FEW_DIGITS = 30
_ROUNDS = 12  # times that outliers are judged anew
# A valley along which poses of narrow joint ranges tell little takes hundreds.
_MOST_ITERATIONS = 400
_ABSURD = 1e3  # plausible sizes


@dataclass(frozen=True, eq=False)
class Fit:
    """Where a search ended.

    method : as of :func:`calib.identify`; observation : Observation, of all poses
    first : Minimum over every pose; best : Minimum over the poses kept
    kept : ndarray of bool, shape (m,), the poses that were fitted; judgement : of all by that fit
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
    judgement: Judgement
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
    now = own.round(own.rigidly_kept(choice.span) if kept is None else kept, start, choice)
    first = now.best if now.kept.all() else None
    for _ in range(_ROUNDS):
        kept = now.judgement.kept
        if np.array_equal(kept, now.kept):
            break
        choice = Directions.at(observation.only(kept), start)
        now = own.round(kept, now.best.values, choice)
    if first is None:
        span = now.choice.span
        first = _minimum(method, observation, now.best.values, span, _FEW_DIGITS)
    regular = False
    for _ in range(_ROUNDS):
        at_end = now.choice.anew(observation.only(now.kept), now.best.values)
        regular = at_end.span.shape[1] >= now.choice.span.shape[1]
        if regular:
            break
        # The start was where more is told: a marker on an axis tells less than one beside it.
        now = own.round(now.kept, start, at_end)
    return Fit(
        method,
        observation,
        first,
        now.best,
        now.kept,
        now.judgement,
        now.readings,
        now.left,
        now.choice.identifiable,
        now.choice.span,
        regular,
    )


class _Round(NamedTuple):
    """One fit to the poses kept, and what it says of all; fields as of :class:`Fit`."""

    kept: Mask
    best: Minimum
    choice: Directions
    readings: LinearProblem
    left: tuple[float, int]
    judgement: Judgement


@dataclass(frozen=True, eq=False)
class _Search:
    """What all rounds of a search share; start : ndarray, shape (p,), SI."""

    method: Method
    observation: Observation
    start: Array

    def rigidly_kept(self, span: Array) -> Mask:
        """Poses to keep by a fit in which nothing yields, all where nothing can."""
        model, every = self.observation.model, np.ones(len(self.observation.data), dtype=bool)
        soft = np.abs(span[model.where(ElasticEffect, LoadEffect)]).sum(axis=0) > 0.0
        if soft.all() or not soft.any():
            return every
        stiff = _minimum(self.method, self.observation, self.start, span[:, ~soft])
        return self.judged(stiff.values, every, span[:, ~soft])[-1].kept

    def round(self, kept: Mask, values: Array, choice: Directions) -> _Round:
        """The fit from ``values`` (p,) on; what diverges stays at the start, and is not estimated."""
        counted = self.observation.only(kept)
        away = partial(diverged, counted.model, counted.data, self.start)
        best = _minimum(self.method, counted, values, choice.span)
        while (out := away(best.values)).any():
            choice = choice.without(counted, self.start, out)
            best = _minimum(self.method, counted, self.start, choice.span, _FEW_DIGITS)
            if not away(best.values).any():
                best = _minimum(self.method, counted, best.values, choice.span)
        return _Round(kept, best, choice, *self.judged(best.values, kept, choice.span))

    def judged(
        self, values: Array, kept: Mask, span: Array
    ) -> tuple[LinearProblem, tuple[float, int], Judgement]:
        """The readings to first order, what the fit leaves of those kept, and what it says of all."""
        observation = self.observation
        readings = _by_instrument(observation, values, span, kept)
        own, rows = of_poses(readings, kept), math.prod(observation.weights.shape[-3:-1])
        known = len(own.off) - observation.model.prior_rows
        cost = float((own.r**2).sum()) + float((own.off[:known] ** 2).sum())
        dof = _freedom(own, int(observation.only(kept).numbers.sum()), known)
        return readings, (cost, dof), judged(observation.data, readings, kept, rows, dof)


def diverged(model: Model, data: Measurements, start: Array, values: Array) -> Mask:
    """Which values (p,) ran away from ``start``: places out of the room, others to absurd sizes."""
    limits = _ABSURD * model.sizes
    limits[placed(model)] = room(model, data)
    return np.asarray(~(np.abs(values - start) <= limits))


def of_poses(readings: LinearProblem, kept: Mask) -> LinearProblem:
    """The readings of some poses (m,), the rows of others zero."""
    if kept.all():
        return readings
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
    dof, sizes = numbers + known - int(readings.span.shape[1]), readings.held[known:]
    if not len(sizes):
        return dof
    return dof + round(float(np.trace(sizes @ readings.held_gains[known:].T)))
