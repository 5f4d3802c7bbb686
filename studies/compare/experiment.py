"""A plan, ready to be predicted and simulated under the paper's approaches and their weightings."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calib.api import in_turn
from calib.arrays import Array
from calib.cell import Cell, Repeatability
from calib.cell.contacts import TOUCHES, touched
from calib.effects.base import Base
from calib.effects.protocol import ElasticEffect, LoadEffect
from calib.effects.tool import Tool
from calib.errors import CalibError
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
from calib.poses import Measurements, Poses
from calib.poses.moves import visits
from calib.scatter import Scatter, Variances, scatter_of
from calib.simulation import approached, draw, whitening
from doe.constraints import scene_of, visible
from doe.request import refuse_unplaced

_PLAUSIBLE_M = 1e-3  # what an assumed error moves the markers by at most


@dataclass(frozen=True)
class Way:
    """One way from readings to parameters: an approach and what it is weighted by."""

    approach: Approach
    weighting: Weighting

    @property
    def key(self) -> str:
        """Short name: ``points``, ``pose plain``, .."""
        return "points" if self.approach == "points" else f"pose {self.weighting}"


POINTS = Way("points", "full")
PLAIN = Way("pose", "plain")
FULL = Way("pose", "full")
WAYS = (PLAIN, Way("pose", "normalised"), FULL, POINTS)
"""Approach #1 in three weightings, and approach #2."""


@dataclass(frozen=True, eq=False)
class SimulatedExperiment:
    """What is measured, and what is true.

    model : Model; poses : Poses, the m readings; seen : ndarray of bool, shape (m, M)
    weights : ndarray, shape (m, C, r, r), whitening matrices of the noise, zero where hidden or before
        the first move, where that does not count
    nominal : ndarray, shape (p,), SI, what is known before: predictions hold there, fits start there
    truth : ndarray, shape (p,), SI, what simulated readings come from
    length : float, m, characteristic length of the plain weighting
    arm : Repeatability, known of the arm that comes to each pose anew; None for one that always returns
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
        known = Variances.of_arm(self.model.robot.dof, self.arm)
        return scatter_of(self.model, self.nominal, self.poses, known)

    def drawn(self, trials: int, rng: np.random.Generator) -> Array:
        """Noisy readings of so many experiments, shape (trials, m, C, r)."""
        readings = self._at_visits(trials, rng)
        noise = np.broadcast_to(self.weights, (trials, *self.weights.shape))
        return np.asarray(readings + draw(noise, rng))

    def _at_visits(self, trials: int, rng: np.random.Generator) -> Array:
        """Readings without noise, shape ((trials,) m, C, r), of an arm that comes to each pose anew."""
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

    def measured(self, points: Array) -> Measurements:
        """Readings (..., m, C, r) as a data set; leading axes are trials."""
        return Measurements(self.poses, points, self.seen, np.full(self.seen.shape, np.nan))

    def observe(self, way: Way, points: Array) -> tuple[Observation, Array]:
        """Readings under a way, and the values (..., p) from which a fit starts.

        points : ndarray, shape (..., m, C, r); leading axes are trials
        """
        data = self.measured(points)
        observation = Points(self.model, data, self.weights, known=self.scatter)
        start = np.broadcast_to(self.nominal, (*points.shape[:-3], len(self.nominal)))
        if way.approach == "points":
            return observation, start
        if len(self.model.where(Tool)):
            start = with_measured_shape(self.model, data, self.nominal)
        shape = self.model.marker_positions(start)
        return as_poses(observation, shape, way.weighting, self.length), start


def experiment_of(
    cell: Cell,
    plan: Poses,
    *,
    values: Array | None = None,
    length: float = 1.0,
    seed: int = 0,
) -> SimulatedExperiment:
    """The readings of a plan in a cell.

    values : ndarray, shape (p,), SI, what predictions and simulations hold at. Without them predictions
        hold at the nominal model and simulations at one that is off by plausible errors, drawn with
        the seed: each parameter by its usual size, or by what moves the markers a millimetre. A load
        effect shows through compliances only: with one in the model, predictions hold at those drawn

    Raises UnknownEffect, EffectCannotAct, CalibError where readings cannot be foreseen.
    """
    refuse_unplaced(cell)
    poses = in_turn(cell, plan)
    model = build(cell, poses).model
    refuse_idle_effects(cell, model, poses)
    seen = visible(scene_of(cell, poses.q))
    _refuse_no_contact(cell, plan)
    truth = plausible(model, poses, seed) if values is None else values
    nominal = model.initial if values is None else values
    if values is None and len(model.where(LoadEffect)):
        soft = model.where(ElasticEffect)
        nominal[soft] = truth[soft]
    counts = seen & ~uncounted(model, poses)[:, None]
    weights = noise_weights(model, nominal, poses, counts)
    arm = cell.repeatability if cell.scatters else None
    return SimulatedExperiment(model, poses, seen, weights, nominal, truth, length, arm)


def _refuse_no_contact(cell: Cell, plan: Poses) -> None:
    apart = np.flatnonzero(touched(cell, plan.q) < 0)
    if len(apart) and all(instrument.touches for instrument in cell.instruments):
        raise CalibError(
            f"pose {plan.names[apart[0]]} of the plan touches nothing to {TOUCHES * 1e3:g} mm; choose "
            "poses that do, or give joint values with more digits"
        )


def refuse_unseen(experiment: SimulatedExperiment, plan: str) -> None:
    """Raise CalibError where nothing can be read at the poses of a plan of this name."""
    if experiment.seen.any():
        return
    named = ", ".join(instrument.name for instrument in experiment.model.instruments)
    raise CalibError(
        f"{named} sees no point at any pose of {plan}; let posecal design choose poses for this cell, "
        "or check where the instrument stands and looks (position_mm, rpy_deg)"
    )


def noise_weights(model: Model, values: Array, poses: Poses, seen: NDArray[np.bool_]) -> Array:
    """Whitening matrices of the readings of a plan, shape (m, C, r, r), zero where hidden."""
    W = whitening(model, values, poses, model.predict(values, poses))
    return np.asarray(np.where(seen[..., None, None], W, 0.0))


def plausible(model: Model, poses: Poses, seed: int) -> Array:
    """A robot that is off as robots are, shape (p,), SI; base and markers where they are thought."""
    elastic = model.where(ElasticEffect)
    soft = model.initial
    soft[elastic] = _sizes(model, soft, poses)[elastic]
    size = _sizes(model, soft, poses)
    values: Array = size * np.random.default_rng(seed).standard_normal(len(size))
    placed = model.where(Base, Tool)
    values[placed] = model.initial[placed]
    values[model.tunings] = model.initial[model.tunings]
    values[elastic] = np.abs(values[elastic])
    return values


def _sizes(model: Model, values: Array, poses: Poses) -> Array:
    """Usual size of each parameter, or what moves the markers a millimetre, shape (p,), SI."""
    metric = model.readout.channels.metric
    _, J = (model if metric else working_points(model)).jacobian(values, poses)
    moved = np.linalg.norm(J, axis=-2).max(axis=(0, 1))
    return np.asarray(np.minimum(model.sizes, _PLAUSIBLE_M / np.maximum(moved, 1e-300)))
