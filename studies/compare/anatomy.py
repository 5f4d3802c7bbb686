"""What a plan's accuracy consists of: pose by pose, and by the number of poses and markers."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np

from calib.arrays import Array, IntArray
from calib.cell import Cell
from calib.cell.targets import targets_of
from calib.model.covariance import gain
from calib.poses import Poses
from studies.compare.experiment import POINTS, WAYS, Experiment, experiment_of
from studies.compare.prediction import Prediction, accuracy_at, predict

_SUBSETS = 7  # drawn of each size
_SIZES = 7


@dataclass(frozen=True, eq=False)
class Curve:
    """Task RMS [m] by a number of things: median, least and largest over subsets of that size.

    Sizes at which no way determines every parameter are left out.

    counts : ndarray of int, shape (s,); rms : dict, way -> ndarray, shape (s, 3); NaN or infinite
        where a way cannot be had or leaves parameters open
    """

    counts: IntArray
    rms: dict[str, Array]


def influence(experiment: Experiment, prediction: Prediction, configurations: int) -> Array:
    """How much of each parameter's variance comes from each configuration, shape (m, p).

    Columns sum to one; their sum over the parameters is what a configuration's noise counts for.
    configurations : int, m; the readings of a plan are a whole number of times as many
    """
    points = experiment.model.predict(experiment.nominal, experiment.poses)
    observation, start = experiment.observe(POINTS, points)
    squared = gain(observation.flat(start)[1], prediction.span) ** 2
    each = experiment.weights[0, ..., 0].size  # numbers of one reading
    read = squared.shape[1] - experiment.model.known_rows  # what is known beside them comes last
    by_reading = squared[:, :read].reshape(len(squared), -1, configurations, each)
    share = by_reading.sum(axis=(1, 3))
    total = share.sum(axis=1, keepdims=True)
    return np.asarray((share / np.where(total > 0.0, total, np.nan)).T)


def influence_by_effect(
    experiment: Experiment, prediction: Prediction, configurations: int
) -> tuple[Array, list[str]]:
    """Influence summed over the parameters of each effect, shape (m, effects), and their names."""
    share = influence(experiment, prediction, configurations)
    effects = np.array([p.effect for p in experiment.model.parameters])
    groups = list(dict.fromkeys(effects.tolist()))
    summed = [np.nansum(share[:, effects == group], axis=1) for group in groups]
    return np.stack(summed, axis=1), groups


def by_poses(cell: Cell, experiment: Experiment, configurations: int, seed: int = 0) -> Curve:
    """Accuracy of random parts of a plan."""
    targets, weights = targets_of(cell)
    rng = np.random.default_rng(seed)
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


def by_markers(cell: Cell, plan: Poses, length: float = 1.0) -> Curve:
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


def _task(experiment: Experiment, targets: Poses, weights: Array) -> dict[str, float]:
    """Task RMS [m] of each way that can be had."""
    ways = experiment.ways
    return {
        way.key: accuracy_at(experiment, predict(experiment, way).covariance, targets, weights)[0]
        for way in ways
    }


def _curve(counts: IntArray, rows: list[list[dict[str, float]]]) -> Curve:
    rms = {}
    for way in WAYS:
        values = [[found.get(way.key, np.inf) for found in row] for row in rows]
        rms[way.key] = np.array([[np.median(v), min(v), max(v)] for v in values]).reshape(-1, 3)
    known = np.any([np.isfinite(v[:, 0]) for v in rms.values()], axis=0)
    return Curve(counts[known], {key: v[known] for key, v in rms.items()})


def _part(experiment: Experiment, kept: IntArray, configurations: int) -> Experiment:
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
    )
