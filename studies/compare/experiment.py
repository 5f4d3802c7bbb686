"""The readings of a plan under the paper's approaches, and the accuracy to expect of each.

Approach #1 computes a full pose of each reading first and is weighted in three ways; approach #2 takes
the marker points as they are.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calib.api import in_turn
from calib.arrays import Array
from calib.cell import Cell, Repeatability
from calib.cell.contacts import TOUCHES, touched
from calib.effects.protocol import ElasticEffect, LoadEffect
from calib.effects.tool_base import Base, Tool
from calib.errors import CalibError
from calib.identification.fit import choose_directions
from calib.identification.identify import uncounted
from calib.instruments import Tracker
from calib.model import Model
from calib.model.build import build, refuse_idle_effects
from calib.model.covariance import working_points
from calib.observations import (
    Approach,
    Observation,
    Points,
    Weighting,
    as_poses,
    orientable,
    with_measured_shape,
)
from calib.observations.scatter import Scatter, Variances, scatter_of
from calib.poses import Measurements, Poses
from calib.poses.moves import visits
from calib.simulation import approached, draw, whitening
from doe.constraints import scene_of, visible
from doe.request import refuse_unplaced

_PLAUSIBLE_M = 1e-3  # what an assumed error moves the markers by at most


@dataclass(frozen=True)
class Way:
    """An approach and what it is weighted by."""

    approach: Approach
    weighting: Weighting

    @property
    def key(self) -> str:
        """``points``, ``pose plain``, .."""
        return "points" if self.approach == "points" else f"pose {self.weighting}"


PLAIN, FULL, POINTS = Way("pose", "plain"), Way("pose", "full"), Way("points", "full")
WAYS = (PLAIN, Way("pose", "normalised"), FULL, POINTS)


@dataclass(frozen=True, eq=False)
class SimulatedExperiment:
    """What is measured, and what is true.

    seen : ndarray of bool, shape (m, M), of the m readings ``poses``
    weights : ndarray, shape (m, C, r, r), whitening matrices of the noise, zero where hidden
    nominal, truth : ndarray, shape (p,), SI: where predictions hold and fits start, and what is read
    length : float, m, which converts rotations in the plain weighting
    arm : Repeatability or None, the scatter of the arm from visit to visit
    """

    model: Model
    poses: Poses
    seen: NDArray[np.bool_]
    weights: Array
    nominal: Array
    truth: Array
    length: float = 1.0
    arm: Repeatability | None = None

    @property
    def ways(self) -> tuple[Way, ...]:
        """The ways that the readings allow: a pose needs the points of three markers."""
        if not all(type(i) is Tracker for i in self.model.instruments) or self.model.scattered:
            return (POINTS,)
        usable = orientable(self.model.marker_positions(self.nominal), self.seen)
        return WAYS if usable.any() else (POINTS,)

    @cached_property
    def scatter(self) -> Scatter | None:
        """How readings err together, None where they do not."""
        if self.arm is None:
            return None
        variances = Variances.of_arm(self.model.robot.dof, self.arm)
        return scatter_of(self.model, self.nominal, self.poses, variances)

    def drawn(self, trials: int, rng: np.random.Generator) -> Array:
        """Noisy readings of several experiments, shape (trials, m, C, r)."""
        readings = self._at_visits(trials, rng)
        noise = np.broadcast_to(self.weights, (trials, *self.weights.shape))
        return np.asarray(readings + draw(noise, rng))

    def _at_visits(self, trials: int, rng: np.random.Generator) -> Array:
        """Readings without noise, shape ((trials,) m, C, r), of an arm that scatters between visits."""
        exact = self.model.predict(self.truth, self.poses)
        if self.arm is None:
            return exact
        frames = self.model.state(self.truth, self.poses).frames
        points = self.model.tip_points(frames, self.truth, self.poses)
        _, origins = self.model.under_markers(frames)
        every = np.broadcast_to(points, (trials, *points.shape))
        moved = approached(every, origins, visits(self.poses), self.arm, rng)
        moved = self.model.readout.channels.seats_kept(moved, points)
        return self.model.readings(self.truth, self.poses, moved)

    def observe(self, way: Way, points: Array) -> tuple[Observation, Array]:
        """Readings (..., m, C, r) of trials under a way, and the values (..., p) where fits start."""
        data = Measurements(self.poses, points, self.seen, np.full(self.seen.shape, np.nan))
        observation = Points(self.model, data, self.weights, known=self.scatter)
        start = np.broadcast_to(self.nominal, (*points.shape[:-3], len(self.nominal)))
        if way.approach == "points":
            return observation, start
        if len(self.model.where(Tool)):
            start = with_measured_shape(self.model, data, self.nominal)
        shape = self.model.marker_positions(start)
        return as_poses(observation, shape, way.weighting, self.length), start


def experiment_of(
    cell: Cell, plan: Poses, *, seed: int = 0, name: str = "the plan"
) -> SimulatedExperiment:
    """The readings of a plan in a cell; the truth is off by plausible errors, drawn with the seed.

    What some way leaves open is nominal in the truth. A load effect shows through compliances only:
    with one in the model, predictions hold at drawn compliances.

    Raises UnknownEffect, EffectCannotAct, CalibError where readings cannot be predicted.
    """
    refuse_unplaced(cell)
    poses = in_turn(cell, plan)
    model, seen = build(cell, poses).model, visible(scene_of(cell, poses.q))
    refuse_idle_effects(cell, model, poses)
    apart = np.flatnonzero(touched(cell, plan.q) < 0)
    if len(apart) and all(instrument.touches for instrument in cell.instruments):
        raise CalibError(
            f"pose {plan.names[apart[0]]} of the plan touches nothing to {TOUCHES * 1e3:g} mm; choose "
            "poses that do, or give joint values with more digits"
        )
    if not seen.any():
        named = ", ".join(instrument.name for instrument in model.instruments)
        raise CalibError(
            f"{named} sees no point at any pose of {name}; let posecal design choose poses for this "
            "cell, or check where the instrument stands and looks (position_mm, rpy_deg)"
        )
    truth, nominal = plausible(model, poses, seed), model.initial
    if len(model.where(LoadEffect)):
        soft = model.where(ElasticEffect)
        nominal[soft] = truth[soft]
    weights = noise_weights(model, nominal, poses, seen & ~uncounted(model, poses)[:, None])
    arm = cell.repeatability if cell.scatters else None
    made = SimulatedExperiment(model, poses, seen, weights, nominal, truth, arm=arm)
    known = np.all([np.isfinite(predict(made, way).std) for way in made.ways], axis=0)
    return replace(made, truth=np.where(known, truth, nominal))


def noise_weights(model: Model, values: Array, poses: Poses, seen: NDArray[np.bool_]) -> Array:
    """Whitening matrices of the readings of a plan, shape (m, C, r, r), zero where hidden."""
    W = whitening(model, values, poses, model.predict(values, poses))
    return np.asarray(np.where(seen[..., None, None], W, 0.0))


def plausible(model: Model, poses: Poses, seed: int) -> Array:
    """Errors that robots have, shape (p,), SI; base, markers and tunings stay nominal."""
    elastic, soft = model.where(ElasticEffect), model.initial
    soft[elastic] = _sizes(model, soft, poses)[elastic]
    size = _sizes(model, soft, poses)
    values: Array = size * np.random.default_rng(seed).standard_normal(len(size))
    for fixed in (model.where(Base, Tool), model.tunings):
        values[fixed] = model.initial[fixed]
    values[elastic] = np.abs(values[elastic])
    return values


def _sizes(model: Model, values: Array, poses: Poses) -> Array:
    """Usual size of each parameter, or what moves the markers a millimetre, shape (p,), SI."""
    metric = model.readout.channels.metric
    _, J = (model if metric else working_points(model)).jacobian(values, poses)
    moved = np.linalg.norm(J, axis=-2).max(axis=(0, 1))
    return np.asarray(np.minimum(model.sizes, _PLAUSIBLE_M / np.maximum(moved, 1e-300)))


@dataclass(frozen=True, eq=False)
class Prediction:
    """What a way will know of the parameters.

    span : ndarray, shape (p, k), directions that the plan determines
    covariance : ndarray, shape (p, p), SI, zero for parameters that it leaves open
    """

    way: Way
    span: Array
    covariance: Array

    @property
    def std(self) -> Array:
        """Standard deviations, shape (p,), SI, NaN for what the plan leaves open."""
        variance = np.diag(self.covariance)
        return np.where(variance > 0.0, np.sqrt(variance), np.nan)


def predict(experiment: SimulatedExperiment, way: Way) -> Prediction:
    """First-order covariance at the nominal model, the noise as stated.

    The points decide for every way what the plan determines: poses computed from them know no more.
    """
    points = experiment.model.predict(experiment.nominal, experiment.poses)
    observation, start = experiment.observe(POINTS, points)
    kept = choose_directions(observation, start).kept
    kept = kept[np.abs(observation.flat(start)[1][:, kept]).any(axis=0)]
    if way.approach == "points":
        span = np.eye(len(start))[:, kept]
    else:
        observation, start = experiment.observe(way, points)
        span, lost = observation.span(), np.setdiff1d(np.arange(len(start)), kept)
        span = span[:, ~np.abs(span[lost]).any(axis=0)]  # that moves nothing but what is kept
        full, _ = experiment.observe(FULL, points)
        span = span[:, choose_directions(full, start, span).kept]
    return Prediction(way, span, observation.covariance(start, span))
