"""The criteria of ISO 9283 as repeated readings of a table show them, in the base frame of a result."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from calib.arm.kinematics import forward
from calib.arm.se3 import fit_rigid, rotate, so3_log
from calib.arrays import Array, Mask
from calib.compensation.estimate import Estimate
from calib.errors import CalibError
from calib.identification.noise_level import believed_sigma
from calib.iso9283.formulas import (
    accuracy_drift,
    angles,
    compliance,
    distances,
    largest_distance,
    position_accuracy,
    position_repeatability,
)
from calib.model import Model
from calib.observations import orientable
from calib.poses import Measurements, Poses
from calib.poses.moves import alike, in_order, visits
from calib.uncertainty.expanded import Interval


@dataclass(frozen=True, eq=False)
class MarkerReadings:
    """Readings of one marker, and the turns of the tip where its markers tell them, in base axes.

    points, seen : ndarray, shapes (m, 3), m, and (m,), of the marker
    commanded, predicted : ndarray, shape (m, 3), m, of the nominal and of the identified arm
    turns : ndarray, shape (m, 3), rad, of the tip against the nominal one; NaN where none is told
    R : ndarray, shape (m, 3, 3), of the base in the frame of each station
    sigma : float, m, of one coordinate of the instrument as stated
    """

    marker: int
    model: Model
    estimate: Estimate
    poses: Poses
    points: Array
    seen: Mask
    commanded: Array
    predicted: Array
    turns: Array
    R: Array
    sigma: float


def session_of(estimate: Estimate, data: Measurements, marker: str | None) -> MarkerReadings:
    """The table by what a result knows of base and markers; the first marker that is read, by default.

    Raises CalibError: no tracker reads points, or not that marker.
    """
    found = estimate.model.tracked(data)
    if found is None:
        raise CalibError(
            "the criteria of ISO 9283 are made of points; here no tracker (kind points) reads markers"
        )
    model, data = found
    shown = np.flatnonzero(np.any(data.seen, axis=0))
    read = [model.marker_names[k] for k in shown]
    if marker is not None and marker not in read:
        raise CalibError(f"no marker {marker!r} is read here; there are {', '.join(read)}")
    j = model.marker_names.index(read[0] if marker is None else marker)
    values, poses = estimate.values, data.poses
    R, p = model.placement(values, poses)
    inverse = np.swapaxes(R, -1, -2)
    points = rotate(inverse[:, None], data.readings[..., :3] - p[:, None])
    markers, nominal = model.marker_positions(values), forward(model.robot, poses.q)
    tip = model.marker_frames[j]
    R_tip, o_tip = nominal.R[:, tip], nominal.o[:, tip]
    frames = model.state(values, poses).frames
    turns = np.full((len(poses), 3), np.nan)
    told = orientable(markers, data.seen & (model.marker_frames == tip))
    if told.any():
        T = fit_rigid(points[told], np.broadcast_to(markers, points[told].shape),
                      (data.seen[told] & (model.marker_frames == tip)).astype(float))  # fmt: skip
        turns[told] = so3_log(T[:, :3, :3] @ np.swapaxes(R_tip[told], -1, -2))
    return MarkerReadings(
        j, model, estimate, poses, points[:, j], data.seen[:, j], rotate(R_tip, markers[j]) + o_tip,
        model.tip_points(frames, values, poses)[:, j], turns, R, _sigma(model, values, data),
    )  # fmt: skip


def _sigma(model: Model, values: Array, data: Measurements) -> float:
    W = model.readout.whitening(values, data.poses, data.readings[..., :3], data.sigma)
    return believed_sigma(data, W * data.seen[..., None, None], model.readout.channels.lengths)


_GROUP = 10  # cycles whose mean counts for drift (7.6)
_AXIS = np.cos(np.radians(10.0))  # a force so close to an axis of the base is along it
_NOTHING = 1e-6  # N
AXES = ("x", "y", "z")


@dataclass(frozen=True, eq=False)
class Cycles:
    """A pose that was reached again and again from one side, in the order of time.

    approach : signs of the joints' last motions, empty where the table does not say them
    points : ndarray, shape (n, 3), m; turns : ndarray, shape (n, 3), rad, or None
    commanded, predicted : ndarray, shape (3,), m
    """

    name: str
    state: int
    approach: str
    points: Array
    turns: Array | None
    commanded: Array
    predicted: Array

    @property
    def accuracy(self) -> tuple[Interval, Array]:
        return position_accuracy(self.points, self.commanded)

    @property
    def left(self) -> Interval:
        """AP against what the identified arm predicts."""
        return position_accuracy(self.points, self.predicted)[0]

    @property
    def repeatability(self) -> Interval:
        return position_repeatability(self.points)

    @property
    def angles(self) -> tuple[Array, Array] | None:
        return None if self.turns is None else angles(self.turns)

    @property
    def drift(self) -> float | None:
        """By means of ten cycles, None where there are fewer than two of these."""
        groups = len(self.points) // _GROUP
        if groups < 2:
            return None
        own = self.points[: groups * _GROUP].reshape(groups, _GROUP, 3)
        return accuracy_drift(own.mean(axis=1))


@dataclass(frozen=True)
class DistanceCriteria:
    """AD and RD between two poses of equal load; commanded : m."""

    first: str
    second: str
    cycles: int
    commanded: float
    accuracy: Interval
    repeatability: Interval


@dataclass(frozen=True)
class StaticCompliance:
    """Static compliance at a pose along a force, in base axes; figure in m/N."""

    name: str
    direction: str
    readings: int
    figure: Interval


@dataclass(frozen=True, eq=False)
class MeasuredCriteria:
    """Criteria of ISO 9283 measured from repeated poses.

    several : pose -> vAP, m, and how many ways of coming
    """

    cycles: tuple[Cycles, ...]
    distances: tuple[DistanceCriteria, ...]
    several: dict[str, tuple[float, int]]
    compliance: tuple[StaticCompliance, ...]


def measured(session: MarkerReadings) -> MeasuredCriteria:
    """The criteria of every pose that was reached twice at least, and of every force that changed."""
    cycles = tuple(_cycles(session))
    several = {}
    for _, group in itertools.groupby(cycles, key=lambda own: own.state):
        ways = list(group)
        if len(ways) > 1:
            means = np.array([own.points.mean(axis=0) for own in ways])
            several[ways[0].name] = largest_distance(means), len(ways)
    return MeasuredCriteria(
        cycles, tuple(_distances(session, cycles)), several, tuple(_compliance(session))
    )


def _cycles(session: MarkerReadings) -> Iterator[Cycles]:
    """One for each state and each way of coming to it that was taken twice at least."""
    poses = session.poses
    state, stay = alike(poses), visits(poses)
    approach = None if poses.approach_derived else poses.approach
    sides = np.zeros(len(poses), dtype=int)
    if approach is not None:
        sides = np.unique(approach, axis=0, return_inverse=True)[1].reshape(-1)
    order = in_order(poses)
    for s in dict.fromkeys(state[order].tolist()):
        for side in dict.fromkeys(sides[order][state[order] == s].tolist()):
            here = [i for i in order if state[i] == s and sides[i] == side and session.seen[i]]
            stays = list(dict.fromkeys(stay[here].tolist()))
            if len(stays) < 2:
                continue
            members = [[i for i in here if stay[i] == v] for v in stays]
            turns = np.array([session.turns[own].mean(axis=0) for own in members])
            first = here[0]
            yield Cycles(
                poses.names[first],
                s,
                _shown(approach, first),
                np.array([session.points[own].mean(axis=0) for own in members]),
                None if np.isnan(turns).any() else turns,
                session.commanded[first],
                session.predicted[first],
            )


def _shown(approach: Array | None, i: int) -> str:
    """The side from which each joint came, a sign each."""
    if approach is None:
        return ""
    return "".join("+" if s > 0 else "-" if s < 0 else "0" for s in approach[i])


def _distances(session: MarkerReadings, cycles: tuple[Cycles, ...]) -> Iterator[DistanceCriteria]:
    """Between poses under one load, cycle by cycle, each by its first way of coming."""
    poses = session.poses
    load = dict(
        zip(poses.names, np.column_stack([poses.load_mass, poses.wrench]).tolist(), strict=True)
    )
    first = {own.state: own for own in reversed(cycles)}
    for a, b in itertools.combinations([own for own in cycles if first[own.state] is own], 2):
        if load[a.name] != load[b.name]:
            continue
        n = min(len(a.points), len(b.points))
        commanded = float(np.linalg.norm(a.commanded - b.commanded))
        found = distances(a.points[:n], b.points[:n], commanded)
        yield DistanceCriteria(a.name, b.name, n, commanded, *found)


def _compliance(session: MarkerReadings) -> Iterator[StaticCompliance]:
    """Along each axis of the base, or the force's own direction, from what the wrench says."""
    poses, force = session.poses, session.poses.wrench[:, :3]
    size = np.linalg.norm(force, axis=1)
    for c in dict.fromkeys(poses.configuration.tolist()):
        own = np.flatnonzero((poses.configuration == c) & session.seen)
        free = own[size[own] <= _NOTHING]
        loaded = own[size[own] > _NOTHING]
        directions: dict[str, list[int]] = {}
        for i in loaded.tolist():
            directions.setdefault(_direction(force[i] / size[i]), []).append(i)
        for name, members in directions.items():
            along = force[members].mean(axis=0)
            along = along / np.linalg.norm(along)
            every = np.array([*free, *members])
            pulls = force[every] @ along
            if np.ptp(pulls) > _NOTHING:
                yield StaticCompliance(
                    poses.names[own[0]], name, len(every),
                    compliance(pulls, session.points[every] @ along, session.sigma),
                )  # fmt: skip


def _direction(unit: Array) -> str:
    k = int(np.abs(unit).argmax())
    if abs(unit[k]) < _AXIS:
        return "(" + ", ".join(f"{u:.2f}" for u in unit) + ")"
    return f"{'+' if unit[k] > 0 else '-'}{AXES[k]}"
