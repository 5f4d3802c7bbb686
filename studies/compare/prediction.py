"""Predicted accuracy of a plan: of each method, by its poses, markers and instruments."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib.arrays import Array, IntArray
from calib.cell import Cell
from calib.cell.targets import targets_of
from calib.errors import CalibError, InputError
from calib.files.tables import load_plan
from calib.identification.estimators import choose_directions
from calib.model.covariance import accuracy, gain
from calib.poses import Poses
from studies.compare.experiment import (
    FULL,
    POINTS,
    WAYS,
    SimulatedExperiment,
    Way,
    experiment_of,
    refuse_unseen,
)
from studies.compare.record import ByNumber, ReadBy


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

    What the plan determines is judged by the points, whatever the way: nothing can be known from poses
    computed from them that they do not tell themselves.
    """
    points = experiment.model.predict(experiment.nominal, experiment.poses)
    observation, start = experiment.observe(POINTS, points)
    kept = choose_directions(observation, start).kept
    kept = kept[np.abs(observation.flat(start)[1][:, kept]).any(axis=0)]
    if way.approach == "points":
        span = np.eye(len(start))[:, kept]
        return Prediction(way, span, observation.covariance(start, span))
    observation, start = experiment.observe(way, points)
    span, lost = observation.span(), np.setdiff1d(np.arange(len(start)), kept)
    span = span[:, ~np.abs(span[lost]).any(axis=0)]  # that moves nothing but what is kept
    known, _ = experiment.observe(FULL, points)
    span = span[:, choose_directions(known, start, span).kept]
    return Prediction(way, span, observation.covariance(start, span))


def accuracy_at(
    experiment: SimulatedExperiment, covariance: Array, targets: Poses, weights: Array
) -> tuple[float, float]:
    """Expected position error [m] at targets, RMS and worst; infinite where a parameter is open."""
    if (np.diag(covariance) == 0.0).any():
        return np.inf, np.inf
    return accuracy(experiment.model, experiment.nominal, covariance, targets, weights)


_SUBSETS = 7  # drawn of each size
_SIZES = 7


def influence(
    experiment: SimulatedExperiment, prediction: Prediction, configurations: int
) -> Array:
    """How much of each parameter's variance comes from each configuration, shape (m, p).

    Columns sum to one; their sum over the parameters is what a configuration's noise counts for.
    configurations : int, m; the readings of a plan are a whole number of times as many
    """
    points = experiment.model.predict(experiment.nominal, experiment.poses)
    observation, start = experiment.observe(POINTS, points)
    squared = gain(observation.flat(start)[1], prediction.span) ** 2
    read = squared.shape[1] - experiment.model.known_rows  # what is known beside them comes last
    by_reading = squared[:, :read].reshape(len(squared), len(experiment.poses), -1).sum(axis=2)
    share = by_reading.reshape(len(squared), -1, configurations).sum(axis=1)
    total = share.sum(axis=1, keepdims=True)
    return np.asarray((share / np.where(total > 0.0, total, np.nan)).T)


def influence_by_effect(
    experiment: SimulatedExperiment, prediction: Prediction, configurations: int
) -> tuple[Array, list[str]]:
    """Influence summed over the parameters of each effect, shape (m, effects), and their names."""
    share = influence(experiment, prediction, configurations)
    effects = np.array([p.effect for p in experiment.model.parameters])
    groups = list(dict.fromkeys(effects.tolist()))
    summed = [np.nansum(share[:, effects == group], axis=1) for group in groups]
    return np.stack(summed, axis=1), groups


def by_poses(cell: Cell, experiment: SimulatedExperiment, configurations: int) -> ByNumber:
    """Accuracy of random parts of a plan."""
    targets, weights = targets_of(cell)
    rng = np.random.default_rng(0)
    fewest = -(-configurations // 3)
    counts = np.unique(np.linspace(fewest, configurations, _SIZES).round().astype(int))
    rows = []
    for count in counts:
        several = 1 if count == configurations else _SUBSETS
        parts = [rng.permutation(configurations)[:count] for _ in range(several)]
        rows.append(
            [_task(_part(experiment, part, configurations), targets, weights) for part in parts]
        )
    return _curve(counts, rows)


def by_markers(cell: Cell, plan: Poses, length: float) -> ByNumber:
    """Accuracy with fewer markers of the cell, over the sets of each size."""
    targets, weights = targets_of(cell)
    whole = all(i.markers is None for i in cell.instruments)  # else they read parts of a shape
    counts = np.arange(1, len(cell.marker_names) + 1 if whole else 1)
    rows = []
    for count in counts:
        sets = itertools.combinations(range(len(cell.marker_names)), int(count))
        cells = [_with_markers(cell, list(own)) for own in itertools.islice(sets, _SUBSETS)]
        rows.append([_task(experiment_of(c, plan, length=length), targets, weights) for c in cells])
    return _curve(counts, rows)


def _task(experiment: SimulatedExperiment, targets: Poses, weights: Array) -> dict[str, float]:
    """Task RMS [m] of each way that can be had."""
    ways = experiment.ways
    return {
        way.key: accuracy_at(experiment, predict(experiment, way).covariance, targets, weights)[0]
        for way in ways
    }


def _curve(counts: IntArray, rows: list[list[dict[str, float]]]) -> ByNumber:
    """The median over subsets of each size, without sizes at which no way determines everything."""
    rms = {
        way.key: np.array([np.median([one.get(way.key, np.inf) for one in row]) for row in rows])
        for way in WAYS
    }
    rms = {key: own for key, own in rms.items() if np.isfinite(own).any()}
    known = np.any([np.isfinite(own) for own in rms.values()], axis=0) if rms else []
    known_rms = {key: own[known] for key, own in rms.items()}
    return ByNumber.from_result({"counts": counts[known], "rms": known_rms})


def _part(
    experiment: SimulatedExperiment, kept: IntArray, configurations: int
) -> SimulatedExperiment:
    """The experiment with the other configurations out of sight."""
    used = np.isin(np.arange(len(experiment.poses)) % configurations, kept)
    return replace(
        experiment,
        seen=experiment.seen & used[:, None],
        weights=experiment.weights * used[:, None, None, None],
    )


def _with_markers(cell: Cell, kept: list[int]) -> Cell:
    return replace(
        cell,
        marker_names=tuple(cell.marker_names[i] for i in kept),
        markers=cell.markers[kept],
        marker_normals=cell.marker_normals[kept],
        marker_acceptance=cell.marker_acceptance[kept],
        marker_links=tuple(cell.marker_links[i] for i in kept) if cell.marker_links else (),
    )


_MM = 1e3
_PERFECT = 1e4  # times as good as stated: what is left then is the arm's own scatter


def read_by_each(cells: Mapping[Path, Cell], plans: Mapping[str, Path]) -> Iterator[ReadBy]:
    """Every plan under every cell; the targets are those of the first.

    Raises InputError for a cell of another robot, and what :func:`experiment_of` raises.
    """
    (first, own), *others = cells.items()
    targets, weights = targets_of(own)
    firsts: dict[str, float] = {}
    for path, cell in others:
        if cell.robot.joints != own.robot.joints:
            raise InputError(path, "robot", f"has other joints than {first}", "compare one robot")
    for path, cell in cells.items():
        for name, file in plans.items():
            try:
                plan = load_plan(cell, file)
                experiment = experiment_of(cell, plan)
                refuse_unseen(experiment, name)
            except InputError:
                raise
            except CalibError as error:
                raise InputError(path, "", str(error)) from None
            ideal = replace(experiment, weights=experiment.weights * _PERFECT)
            rms, worst = _left(experiment, targets, weights)
            arm, _ = _left(ideal, targets, weights)
            least = firsts.setdefault(name, rms)
            yield ReadBy(
                cell=cell.name,
                instruments=tuple(f"{i.name} ({i.kind})" for i in cell.instruments),
                plan=name,
                poses=len(plan),
                task_rms_mm=rms * _MM,
                task_worst_mm=worst * _MM,
                arm_rms_mm=arm * _MM if cell.scatters else None,
                poses_to_match=len(plan) * (rms / least) ** 2 if np.isfinite(least) else None,
            )


def _left(experiment: SimulatedExperiment, targets: Poses, weights: Array) -> tuple[float, float]:
    found = predict(experiment, POINTS)
    return accuracy_at(experiment, found.covariance, targets, weights)
