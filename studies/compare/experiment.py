"""A plan, ready to be predicted and simulated under the paper's approaches and their weightings."""

from __future__ import annotations

from dataclasses import dataclass, replace
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
from calib.instruments.riding import frame_of
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
from calib.simulation import whitening
from doe.constraints import scene_of, visible
from doe.problem.request import refuse_unplaced
from studies.compare.stated_noise import StatedNoise, displaced_at_visits, noise_of

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
    stated : StatedNoise, how simulated readings err, whatever they are weighted by
    length : float, m, characteristic length of the plain weighting
    cell : Cell, as a fit from nothing but the readings knows it, or None
    exact : ndarray, shape (m, C, r), readings without noise where they are not the model's own, such
        as MuJoCo's; else None
    arm : Repeatability, known of the arm that comes to each pose anew; None for one that always returns
    quiet : float, simulated readings err so many times less than is stated
    """

    model: Model
    poses: Poses
    seen: NDArray[np.bool_]
    weights: Array
    nominal: Array
    truth: Array
    stated: StatedNoise
    length: float = 1.0
    cell: Cell | None = None
    exact: Array | None = None
    arm: Repeatability | None = None
    quiet: float = 1.0

    @property
    def ways(self) -> tuple[Way, ...]:
        """The ways that the readings allow: a pose needs the points of three markers."""
        if not all(type(i) is Tracker for i in self.model.instruments) or self.model.scattered:
            return (POINTS,)
        usable = orientable(self.model.marker_positions(self.nominal), self.seen)
        return WAYS if usable.any() else (POINTS,)

    def readings(self) -> Array:
        """What would be read without noise, shape (m, C, r)."""
        return self.model.predict(self.truth, self.poses) if self.exact is None else self.exact

    @cached_property
    def scatter(self) -> Scatter | None:
        """How readings err together, None where they do not."""
        if self.arm is None:
            return None
        known = Variances.of_arm(self.model.robot.dof, self.arm)
        return scatter_of(self.model, self.nominal, self.poses, known)

    def drawn(self, trials: int, rng: np.random.Generator) -> Array:
        """Noisy readings of so many experiments, shape (trials, m, C, r)."""
        return self.readings() + self._by_arm(trials, rng) + self.noise(trials, rng)

    def noise(self, trials: int, rng: np.random.Generator) -> Array:
        """Errors of the instruments, shape (trials, m, C, r)."""
        exact = self.readings()
        white = rng.standard_normal((trials, *exact.shape)) / self.quiet
        found = np.zeros(white.shape)
        for instrument, part in self.model.readout.channels.blocks:
            own = np.s_[..., part, : instrument.rows]
            start = self._start(instrument.name)[own]
            errors = self.stated.of[instrument.name].errors(white[own], exact[own], start)
            found[own] = errors
        return found

    def _start(self, name: str) -> Array:
        """Where an instrument stands in the frame of its readings, shape (m, C, r)."""
        stands = self.stated.stands.get(name)
        if stands is None:
            return np.zeros(self.weights.shape[:-1])
        frames = self.model.state(self.truth, self.poses).frames
        points = self.model.tip_points(frames, self.truth, self.poses)
        own = next(i for i in self.model.instruments if i.name == name)
        if own.seat is None:
            there = np.broadcast_to(stands, points.shape)
        else:
            origin, axes = frame_of(points[:, own.seat])
            there = np.broadcast_to((origin + stands @ axes)[:, None], points.shape)
        there = self.model.readout.channels.seats_kept(there, points)
        return self.model.readings(self.truth, self.poses, there)

    def _by_arm(self, trials: int, rng: np.random.Generator) -> Array | float:
        """What readings err by as the arm comes to each pose anew, shape (trials, m, C, r)."""
        if not any(self.stated.arm):
            return 0.0
        frames = self.model.state(self.truth, self.poses).frames
        points = self.model.tip_points(frames, self.truth, self.poses)
        _, visit = np.unique(visits(self.poses), return_inverse=True)
        white = rng.standard_normal((trials, int(visit.max()) + 1, 6)) / self.quiet
        _, origins = self.model.under_markers(frames)
        moved = displaced_at_visits(points, origins, visit, white, self.stated.arm)
        moved = self.model.readout.channels.seats_kept(moved, points)
        still, there = (self.model.readings(self.truth, self.poses, p) for p in (points, moved))
        return there - still

    def quieter(self, factor: float) -> SimulatedExperiment:
        """The same with all noise smaller by a factor."""
        arm = self.arm and Repeatability(self.arm.translation / factor, self.arm.rotation / factor)
        weights, quiet = factor * self.weights, factor * self.quiet
        return replace(self, weights=weights, arm=arm, quiet=quiet)

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
    stated: StatedNoise | None = None,
    length: float = 1.0,
    seed: int = 0,
) -> SimulatedExperiment:
    """The readings of a plan in a cell.

    values : ndarray, shape (p,), SI, what predictions and simulations hold at. Without them predictions
        hold at the nominal model and simulations at one that is off by plausible errors, drawn with
        the seed: each parameter by its usual size, or by what moves the markers a millimetre. A load
        effect shows through compliances only: with one in the model, predictions hold at those drawn
    stated : how simulated readings err by the cell's text; without it by the numbers of the cell

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
    stated = noise_of(cell) if stated is None else stated
    return SimulatedExperiment(
        model, poses, seen, weights, nominal, truth, stated, length, cell, arm=arm
    )


def _refuse_no_contact(cell: Cell, plan: Poses) -> None:
    apart = np.flatnonzero(touched(cell, plan.q) < 0)
    if len(apart) and all(instrument.touches for instrument in cell.instruments):
        raise CalibError(
            f"pose {plan.names[apart[0]]} of the plan touches nothing to {TOUCHES * 1e3:g} mm; let "
            "posecal design choose poses that do, or give joint values with more digits"
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
