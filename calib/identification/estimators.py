"""How parameters are found once it is settled which poses count."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from calib.arrays import Array, Mask, by_size, stacked
from calib.effects.base import Base
from calib.effects.protocol import ElasticEffect, LoadEffect
from calib.effects.tool import Tool
from calib.identification.identification import Method
from calib.identification.two_step import alternate
from calib.model import Model
from calib.model.covariance import Identifiable, gain, identifiable
from calib.observations import Observation, points_of
from calib.solver import Minimum, levenberg_marquardt

# A valley along which poses of narrow joint ranges tell little takes hundreds.
_MOST_ITERATIONS = 400
_TURNS = 12  # rigid parameters and elastic differences in turn: each gains three digits
_SETTLED = 1e-6  # of a plausible size
_STIFF = 0.03  # of the plausible size of a compliance: as the drives of a heavy arm yield


class Judged(NamedTuple):
    """Weighted residuals (m, rows), derivatives (m, rows, p), and directions (p, k) they fitted."""

    r: Array
    J: Array
    span: Array


class Estimator(Protocol):
    """A way from readings to values and their covariance."""

    def fit(
        self, observation: Observation, start: Array, span: Array, most: int = _MOST_ITERATIONS
    ) -> Minimum:
        """Least-squares values, moving along ``span`` (p, k), in at most so many iterations."""
        ...

    def judged(
        self, observation: Observation, values: Array, span: Array, kept: Mask | None = None
    ) -> Judged:
        """The marker residuals by which poses and noise are judged.

        values : ndarray, shape (p,), SI; span : ndarray, shape (p, k), directions that were estimated
        kept : ndarray of bool, shape (m,), the poses that were fitted, all without
        """
        ...

    def covariance(self, observation: Observation, values: Array, span: Array) -> Array:
        """Covariance (p, p) for the noise as stated."""
        ...

    def followed(self, observation: Observation, values: Array, span: Array, moved: Array) -> Array:
        """How values follow readings displaced by ``moved`` (m, C, r, b), shape (p, b), SI."""
        ...

    def dof(self, observation: Observation, span: Array) -> int:
        """Degrees of freedom of the residuals; negative where the readings do not suffice.

        span : ndarray, shape (p, k), directions that are estimated
        """
        ...


@dataclass(frozen=True)
class Readings:
    """Every reading as it is, all parameters at once or the paper's two steps in turn."""

    method: Method = "joint"

    def fit(
        self, observation: Observation, start: Array, span: Array, most: int = _MOST_ITERATIONS
    ) -> Minimum:
        if self.method == "two-step":
            return alternate(observation.flat, start, *steps(observation.model, span))
        return levenberg_marquardt(observation.flat, start, span, most)

    def judged(
        self, observation: Observation, values: Array, span: Array, kept: Mask | None = None
    ) -> Judged:
        """At the minimum of the points themselves, from which another weighting keeps the estimate.

        Elsewhere residuals are longer than their spread says, and right poses would stand out.
        """
        if not observation.efficient or observation.weighing is not None:
            counted = observation if kept is None else observation.only(kept)
            values = levenberg_marquardt(points_of(counted).flat, values, span).values
        return Judged(*points_of(observation).linearise(values), span)

    def covariance(self, observation: Observation, values: Array, span: Array) -> Array:
        return observation.covariance(values, span)

    def followed(self, observation: Observation, values: Array, span: Array, moved: Array) -> Array:
        return observation.followed(values, span, moved)

    def dof(self, observation: Observation, span: Array) -> int:
        known = observation.model.known_rows
        return int(observation.numbers.sum()) + known - int(span.shape[1])


@dataclass(frozen=True)
class Differences:
    """Elastic parameters from differences between readings at equal joints.

    Errors of geometry, the same with and without load, drop out of the differences. Base, tool and
    other rigid parameters follow from the readings themselves; the two sets are found in turn.
    """

    def fit(
        self, observation: Observation, start: Array, span: Array, most: int = _MOST_ITERATIONS
    ) -> Minimum:
        del most  # each of its turns takes few
        soft = _soft(observation.model, span)
        values, iterations, settled = start, 0, False
        for _ in range(_TURNS):
            rigid = levenberg_marquardt(observation.flat, values, span[:, ~soft])
            elastic = levenberg_marquardt(
                points_of(observation, centred=True).flat, rigid.values, span[:, soft]
            )
            iterations += rigid.iterations + elastic.iterations
            moved = np.abs(elastic.values - values) / observation.model.sizes
            values = elastic.values
            settled = bool(moved.max(initial=0.0) < _SETTLED)
            if settled:
                break
        converged = rigid.converged & elastic.converged & settled
        return Minimum(values, elastic.cost, converged, iterations)

    def judged(
        self, observation: Observation, values: Array, span: Array, kept: Mask | None = None
    ) -> Judged:
        del kept  # differences are weighted by their noise: their minimum is the points' own
        soft = span[:, _soft(observation.model, span)]
        return Judged(*points_of(observation, centred=True).linearise(values), soft)

    def covariance(self, observation: Observation, values: Array, span: Array) -> Array:
        """Both sets are linear in the same readings: what the elastic ones owe to noise goes into
        the rigid ones.
        """
        from_readings, from_differences = self._gains(observation, values, span)
        gain = from_readings + from_differences
        return np.asarray(gain @ gain.T)

    def followed(self, observation: Observation, values: Array, span: Array, moved: Array) -> Array:
        read, centred = (o.rows(moved) for o in (observation, points_of(observation, centred=True)))
        read, centred = (stacked(rows) for rows in (read, centred))
        gains = self._gains(observation, values, span)
        # What is known beside the readings comes last, and stays as it is.
        from_readings, from_differences = (gain[:, : len(read)] for gain in gains)
        return np.asarray(from_readings @ read + from_differences @ centred)

    def _gains(self, observation: Observation, values: Array, span: Array) -> tuple[Array, Array]:
        """How values follow weighted readings and their differences, both (p, N)."""
        soft = _soft(observation.model, span)
        rigid, elastic = span[:, ~soft], span[:, soft]
        _, J = observation.flat(values)
        _, J_centred = points_of(observation, centred=True).flat(values)
        to_rigid, to_elastic = np.linalg.pinv(J @ rigid), np.linalg.pinv(J_centred @ elastic)
        k = len(to_rigid)
        # Each set is fitted beside the other: where both stand still, all is solved together.
        both = np.eye(span.shape[1])
        both[:k, k:], both[k:, :k] = to_rigid @ J @ elastic, to_elastic @ J_centred @ rigid
        settled = np.hstack([rigid, elastic]) @ np.linalg.inv(both)
        return settled[:, :k] @ to_rigid, settled[:, k:] @ to_elastic

    def dof(self, observation: Observation, span: Array) -> int:
        numbers = observation.numbers
        groups = (numbers[index] for index in by_size(observation.data.poses.configuration))
        spare = sum(int((own.sum(axis=1) - own.max(axis=1)).sum()) for own in groups)
        soft = int(_soft(observation.model, span).sum())
        return spare - soft if soft else -1


def of_prior(observation: Observation, values: Array, span: Array) -> Array:
    """How least-squares values follow the rows of the robot's type, shape (p, k)."""
    follow = gain(observation.flat(values)[1], span)
    return follow[:, follow.shape[1] - observation.model.prior_rows :]


def unspent(observation: Observation, values: Array, span: Array) -> float:
    """Rows of the robot's type beyond the parameters that they determine: no residuals of readings."""
    rows = observation.model.prior_rows
    if not rows:
        return 0.0
    own = observation.beside(values)[1][-rows:]
    return rows - float(np.trace(own @ of_prior(observation, values, span)))


def steps(model: Model, span: Array) -> tuple[Array, Array]:
    """The directions of the paper's step 1 (base and tool) and of step 2 (the rest)."""
    first = np.abs(span[model.where(Base, Tool)]).sum(axis=0) > 0.0
    return span[:, first], span[:, ~first]


def rigid_directions(model: Model, span: Array) -> Array:
    """The directions (columns of span, shape (p, k)) that move nothing elastic."""
    return span[:, ~_soft(model, span)]


def _soft(model: Model, span: Array) -> Mask:
    soft = model.where(ElasticEffect, LoadEffect)
    return np.asarray(np.abs(span[soft]).sum(axis=0) > 0.0)


def choose_directions(
    observation: Observation, values: Array, span: Array | None = None
) -> Identifiable:
    """What the data determine at some values.

    span : ndarray, shape (p, k), directions to choose from; the observation's by default
    Elastic elements are taken as a little soft at least: a load effect shows through them only.
    """
    model = observation.model
    probe = values.copy()
    elastic = model.where(ElasticEffect)
    probe[elastic] = np.maximum(probe[elastic], _STIFF * model.sizes[elastic])
    _, J = observation.flat(probe)
    span = observation.span() if span is None else span
    ids = [p.id for p in model.parameters]
    sizes, names = [], []
    for direction in span.T:
        members = np.flatnonzero(direction)
        alone = len(members) == 1
        sizes.append(model.sizes[members].max())
        names.append(ids[members[0]] if alone else "tool (as one body)")
    return identifiable(J @ span, np.array(sizes), tuple(names))
