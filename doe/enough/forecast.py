"""What is expected of the estimate after each further pose, as ``calib.identify`` will say it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from calib.covariance import accuracy, covariance, identifiable, ignorance
from calib.model import Model
from calib.poses import IntArray, Poses
from calib.se3 import Array
from doe.allowed import Allowed
from doe.blocks import Blocks
from doe.criteria import Criterion
from doe.exchange import greedy

_OPEN = 0.05**2  # information of a direction that is as uncertain as twenty plausible sizes


@dataclass(frozen=True, eq=False)
class Step:
    """What will be known after one more pose.

    pose : str, empty for what is known now; readings : int, in all
    task_rms, task_worst : float, m, expected at the targets; what is open is off by its plausible
        size, as far as the others do not make up for it
    std : ndarray, shape (p,), SI, NaN for what is open
    open : tuple of str, parameters that cannot be told
    """

    pose: str
    readings: int
    task_rms: float
    task_worst: float
    std: Array
    open: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Forecast:
    """Model and values at which all is linearised, and where accuracy is wanted."""

    model: Model
    values: Array
    targets: Poses
    weights: Array

    def steps(
        self, known: Array, readings: int, further: Iterable[tuple[str, int, Array]]
    ) -> Iterator[Step]:
        """What is known of rows (N, p), then with each further pose: its name, readings and rows.

        Rows are in standard deviations per plausible size.
        """
        R = root(known)
        yield self._step("", readings, R)
        for name, count, rows in further:
            R, readings = root(np.concatenate([R, rows])), readings + count
            yield self._step(name, readings, R)

    def _step(self, pose: str, readings: int, R: Array) -> Step:
        sizes, p = self.model.sizes, len(self.values)
        ids = tuple(parameter.id for parameter in self.model.parameters)
        choice = identifiable(R, np.ones(p), ids)
        known = np.zeros(p, dtype=bool)
        known[choice.kept] = True
        span = np.eye(p)[:, choice.kept]
        cov = covariance(R, span) + ignorance(R, span, np.ones(p), ~known)
        cov = cov * np.outer(sizes, sizes)
        rms, worst = accuracy(self.model, self.values, cov, self.targets, self.weights)
        std = np.where(known, np.sqrt(np.diag(cov)), np.nan)
        lost = tuple(name for entry in choice.unidentifiable for name in entry.names)
        return Step(pose, readings, rms, worst, std, lost)


def root(rows: Array) -> Array:
    """R (p, p) with ``R^T R = rows^T rows``."""
    R = np.linalg.qr(rows, mode="r")
    return np.concatenate([R, np.zeros((rows.shape[1] - len(R), rows.shape[1]))])


def best_next(criterion: Criterion, blocks: Blocks, count: int) -> IntArray:
    """The candidates that add most, one after the other, beside what is known already.

    What nothing tells of counts as twenty plausible sizes uncertain: it is closed first.
    """
    p = len(blocks.fixed)
    beside = Blocks(blocks.packed, blocks.fixed + _OPEN * np.eye(p), blocks.rank)
    rules = Allowed(np.zeros(len(blocks), dtype=int), np.zeros(1), np.array([count]), 1)
    return greedy(criterion, beside, rules)
