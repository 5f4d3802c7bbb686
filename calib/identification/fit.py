"""The fit to readings: directions that they determine, values along these, and poses that belong.

A fit judges every pose, and what it rejects stays out of the next, until the judgement stands.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Literal

import numpy as np

from calib.arrays import Array, Mask
from calib.effects.protocol import ElasticEffect, LoadEffect
from calib.effects.tool_base import Base, Tool
from calib.identification.outliers import Judgement, judged
from calib.identification.start import diverged
from calib.model import Model
from calib.model.covariance import Identifiable, Unidentifiable, identifiable
from calib.observations import Observation, points_of
from calib.observations.linear import LinearProblem
from calib.solver import Linearise, Minimum, condensed, levenberg_marquardt, normal_equations

_ROUNDS = 12  # times that outliers are judged anew
# A valley along which poses of narrow joint ranges tell little takes hundreds.
_MOST_ITERATIONS = 400
# Of a fit that gross errors bend only the size of what it leaves is stated: five digits of it.
_FEW_DIGITS = 30
_STIFF = 0.03  # of the plausible size of a compliance: as the drives of a heavy arm yield
_DIVERGED = "these poses tell so little of it that its estimate ran away"

Method = Literal["joint", "two-step"]
"""All parameters at once, or the paper's two steps in turn."""


@dataclass(frozen=True, eq=False)
class Directions:
    """The directions in which values are estimated.

    among : ndarray, shape (p, n), directions to choose from; span : ndarray, shape (p, k), those chosen
    choice : Identifiable, what the data determine
    diverged : tuple of Unidentifiable, that are not among them, for a fit lost them
    """

    among: Array
    span: Array
    choice: Identifiable
    diverged: tuple[Unidentifiable, ...]

    @classmethod
    def at(
        cls,
        observation: Observation,
        values: Array,
        among: Array | None = None,
        diverged: tuple[Unidentifiable, ...] = (),
    ) -> Directions:
        """What the data determine at some values (p,)."""
        among = observation.span() if among is None else among
        chosen = choose_directions(observation, values, among)
        choice = replace(chosen, unidentifiable=(*chosen.unidentifiable, *diverged))
        return cls(among, among[:, chosen.kept], choice, diverged)

    def anew(self, observation: Observation, values: Array) -> Directions:
        """The choice linearised at other values."""
        return self.at(observation, values, self.among, self.diverged)

    def without(self, observation: Observation, values: Array, out: Mask) -> Directions:
        """The choice without values (p,) whose estimates diverged."""
        names = tuple(observation.model.parameters[i].id for i in np.flatnonzero(out))
        among = self.among[:, ~self.among[out].any(axis=0)]
        diverged = (*self.diverged, Unidentifiable(names, _DIVERGED))
        return self.at(observation, values, among, diverged)


@dataclass(frozen=True, eq=False)
class Fit:
    """Where a search ended.

    method : as of :func:`calib.identify`; observation : Observation, of all poses
    first : Minimum over every pose; best : Minimum over the poses kept
    kept : ndarray of bool, shape (m,), the poses that were fitted; judgement : of all by that fit
    readings : LinearProblem, of all poses, by which they were judged
    left : what the kept poses leave of them, in the noise as stated, and its degrees of freedom. What
        is known beside the readings counts as they do, but for the sizes of errors
    directions : in which values were estimated: more than the readings determine where the sizes of
        errors hold what those leave open
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
    directions: Directions
    regular: bool

    @property
    def model(self) -> Model:
        """As it was fitted."""
        return self.observation.model

    @property
    def values(self) -> Array:
        """The estimate, shape (p,), SI."""
        return self.best.values

    @property
    def span(self) -> Array:
        """Directions that were estimated, shape (p, k)."""
        return self.directions.span

    @property
    def choice(self) -> Identifiable:
        """What the readings determine."""
        return self.directions.choice

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
    fitted = partial(_fitted, method, observation, start)
    directions = Directions.at(observation, start)
    if kept is None:
        kept = _rigidly_kept(method, observation, start, directions.span)
    fit = fitted(kept, start, directions)
    first = fit.best if fit.kept.all() else None
    for _ in range(_ROUNDS):
        kept = fit.judgement.kept
        if np.array_equal(kept, fit.kept):
            break
        fit = fitted(kept, fit.values, Directions.at(observation.only(kept), start))
    first = first or _minimum(method, observation, fit.values, fit.span, _FEW_DIGITS)
    for _ in range(_ROUNDS):
        at_end = fit.directions.anew(fit.counted, fit.values)
        if at_end.span.shape[1] >= fit.span.shape[1]:
            return replace(fit, first=first, regular=True)
        # The start was where more is told: a marker on an axis tells less than one beside it.
        fit = fitted(fit.kept, start, at_end)
    return replace(fit, first=first)


def _fitted(
    method: Method,
    observation: Observation,
    start: Array,
    kept: Mask,
    values: Array,
    directions: Directions,
) -> Fit:
    """One fit from ``values`` (p,) on; what diverges stays at the start, and is not estimated."""
    counted = observation.only(kept)
    away = partial(diverged, counted.model, counted.data, start)
    best = _minimum(method, counted, values, directions.span)
    while (out := away(best.values)).any():
        directions = directions.without(counted, start, out)
        best = _minimum(method, counted, start, directions.span, _FEW_DIGITS)
        if not away(best.values).any():
            best = _minimum(method, counted, best.values, directions.span)
    judgement = _judged(observation, best.values, kept, directions.span)
    return Fit(method, observation, best, best, kept, *judgement, directions, regular=False)


def _rigidly_kept(method: Method, observation: Observation, start: Array, span: Array) -> Mask:
    """Poses to keep by a fit in which nothing yields, all where nothing can."""
    every = np.ones(len(observation.data), dtype=bool)
    soft = span[observation.model.where(ElasticEffect, LoadEffect)].any(axis=0)
    if soft.all() or not soft.any():
        return every
    stiff = _minimum(method, observation, start, span[:, ~soft])
    return _judged(observation, stiff.values, every, span[:, ~soft])[0].kept


def _judged(
    observation: Observation, values: Array, kept: Mask, span: Array
) -> tuple[Judgement, LinearProblem, tuple[float, int]]:
    """What a fit says of all poses, the readings, and what it leaves of those kept.

    Poses are judged as if nothing but the instrument erred, at the minimum of the readings themselves,
    from which another weighting keeps the estimate: elsewhere residuals are longer than their spread
    says, and right poses would stand out.
    """
    points = replace(points_of(observation), scatter=None)
    if not observation.efficient or observation.weighing is not None:
        values = levenberg_marquardt(points.only(kept).flat, values, span).values
    readings = points.linear(values, span)
    fitted = of_poses(readings, kept)
    known = len(fitted.off) - observation.model.prior_rows
    cost = float((fitted.r**2).sum()) + float((fitted.off[:known] ** 2).sum())
    dof = int(observation.only(kept).numbers.sum()) + known - int(span.shape[1])
    if len(sizes := fitted.held[known:]):  # they count less what they determine of the values
        dof += round(float(np.trace(sizes @ fitted.held_gains[known:].T)))
    rows = math.prod(observation.weights.shape[-3:-1])
    return judged(observation.data, readings, kept, rows, dof), readings, (cost, dof)


def of_poses(readings: LinearProblem, kept: Mask) -> LinearProblem:
    """The readings of some poses (m,), the rows of others zero."""
    if kept.all():
        return readings
    r, J = readings.r * kept[:, None], readings.J * kept[:, None, None]
    return replace(readings, r=r, J=J)


def choose_directions(
    observation: Observation, values: Array, span: Array | None = None
) -> Identifiable:
    """The subset of directions that the data determine, linearised at some values.

    span : ndarray, shape (p, k), directions to choose from; the observation's by default
    Elastic elements are taken as a little soft at least: a load effect shows through them only.
    """
    model, probe = observation.model, values.copy()
    elastic = model.where(ElasticEffect)
    probe[elastic] = np.maximum(probe[elastic], _STIFF * model.sizes[elastic])
    span = observation.span() if span is None else span
    moves = span != 0.0
    sizes = (model.sizes[:, None] * moves).max(axis=0, initial=0.0)
    names = tuple(
        model.parameters[int(np.argmax(own))].id if own.sum() == 1 else "tool (as one body)"
        for own in moves.T
    )
    return identifiable(condensed(observation.flat(probe)[1]) @ span, sizes, names)


# -- values ----------------------------------------------------------------------------------------


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
    placement = span[observation.model.where(Base, Tool)].any(axis=0)
    return _alternate(observation.flat, start, span[:, placement], span[:, ~placement])


# The paper's two steps hold to first order only when taken once, for they exchange R_base and R_robot;
# here step 1 uses the exact derivative at the present base. Alternation is block coordinate descent:
# many turns where base and tool correlate with joint offsets, so they are made on the normal equations,
# and the model is linearised anew when they have settled. The minimum is that of the joint solver.

_SETTLED = 1e-6  # of the standard deviations of the estimate
_SINGULAR = 1e-13  # of the largest eigenvalue
_MOST_TURNS = 200_000
_MOST_LINEARISATIONS = 60


def _alternate(linearise: Linearise, start: Array, placement: Array, rest: Array) -> Minimum:
    """Minimise by turns over base and tool, directions (p, a), and all else, directions (p, b)."""
    span, a = np.column_stack([placement, rest]), placement.shape[1]
    values, turns, converged = np.array(start, dtype=float), 0, False
    for _ in range(_MOST_LINEARISATIONS):
        r, J = linearise(values)
        cost, g, A = normal_equations(r, J @ span)
        step, used = _turns(A, g, a, _MOST_TURNS - turns)
        turns, values = turns + used, values + span @ step
        least = _SETTLED**2 * max(1.0, float(cost) / max(len(step), 1))
        converged = turns < _MOST_TURNS and bool(step @ A @ step <= least)
        if converged:
            break
    r, _ = linearise(values)
    return Minimum(values, np.sum(r**2, axis=-1), np.array(converged), turns)


def _turns(A: Array, g: Array, a: int, most: int) -> tuple[Array, int]:
    """Solve ``A step = g`` by turns, the first a and then the others (Gauss-Seidel), and their number.

    Columns are scaled to one; what rounding alone tells stays put.
    """
    scale = np.sqrt(np.where(np.diag(A) > 0.0, np.diag(A), 1.0))
    A, g = A / np.outer(scale, scale), g / scale
    first, other = (np.linalg.pinv(A[p, p], _SINGULAR, True) for p in (slice(a), slice(a, None)))
    step, turns, settled = np.zeros_like(g), 0, False
    while turns < most and not settled:
        turns, before = turns + 1, step.copy()
        step[:a] = first @ (g[:a] - A[:a, a:] @ step[a:])
        step[a:] = other @ (g[a:] - A[a:, :a] @ step[:a])
        change = step - before
        length = max(1.0, float(step @ A @ step))
        moved = float(change @ A @ change)
        settled = not 0 < a < len(g) or moved <= (1e-3 * _SETTLED) ** 2 * length
    return step / scale, turns
