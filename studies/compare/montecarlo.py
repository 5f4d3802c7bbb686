"""Simulated measurements and full refits, many at once.

A trial is drawn from the full model, equilibrium iterated, and fitted by the search that identifies
real data. The fits start where readings without noise lead from the robot as it is thought to be: they
know what real data do not, where the base stands, that no pose is wrong, how large the noise is. Trials
come in blocks of array operations; each block has a seed of its own, so figures do not depend on who
computes it, where, or in which order.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib.arrays import Array
from calib.solver import levenberg_marquardt
from calib.threads import one_blas_thread
from studies.compare.experiment import SimulatedExperiment
from studies.compare.prediction import Prediction

MOST_TRIALS = 50  # a block: enough for array operations to pay, few enough to stay in the cache
_MOST_NUMBERS = 4_000_000  # entries of the derivatives of one block


@dataclass(frozen=True, eq=False)
class Refits:
    """What the trials of one plan found, or those of a block.

    errors : dict, way -> ndarray, shape (trials, p), SI, estimate minus truth; zero for parameters that
        the plan leaves open
    settled : dict, way -> ndarray of bool, shape (trials,)
    cost : dict, way -> ndarray, shape (trials,), weighted sum of squares that is left
    """

    errors: dict[str, Array]
    settled: dict[str, NDArray[np.bool_]]
    cost: dict[str, Array]

    @property
    def trials(self) -> int:
        """Trials that were done."""
        return len(next(iter(self.errors.values()))) if self.errors else 0

    def of(self, way: str) -> Array:
        """Errors of the trials that settled, shape (n, p), SI."""
        return self.errors[way][self.settled[way]]


def without_noise(experiment: SimulatedExperiment, prediction: Prediction) -> tuple[Array, Array]:
    """Where a fit of readings without noise ends, and where it starts, shape (p,) each, SI."""
    exact = experiment.model.predict(experiment.truth, experiment.poses)
    observation, start = experiment.observe(prediction.way, exact)
    return levenberg_marquardt(observation.flat, start, prediction.span).values, start


@one_blas_thread
def refit(
    experiment: SimulatedExperiment,
    predictions: Sequence[Prediction],
    trials: int,
    seed: np.random.SeedSequence,
    moves: Mapping[str, Array],
) -> Refits:
    """Draw readings and estimate the parameters of each, by every way from the same readings.

    moves : way -> ndarray, shape (p,), SI, by how much readings without noise move its estimate
    """
    points = experiment.drawn(trials, np.random.default_rng(seed))
    found = Refits({}, {}, {})
    for prediction in predictions:
        key = prediction.way.key
        observation, start = experiment.observe(prediction.way, points)
        best = levenberg_marquardt(observation.flat, start + moves[key], prediction.span)
        errors = best.values - experiment.truth
        found.errors[key] = np.where(np.isnan(prediction.std), 0.0, errors)
        found.settled[key], found.cost[key] = best.converged, best.cost
    return found


def refits(
    experiment: SimulatedExperiment,
    predictions: Sequence[Prediction],
    trials: int,
    *,
    seed: int | Sequence[int] = 0,
    executor: Executor | None = None,
    progress: Callable[[int], None] = lambda _: None,
) -> Refits:
    """Monte Carlo study of one plan.

    trials : int; seed : int, or several, such as a number for each plan beside the user's
    executor : where blocks are computed, here without one
    progress : called with the number of trials that were just done

    Figures do not depend on the executor, on machines of one kind to the last digit.
    """
    sizes = _block_sizes(experiment, trials)
    seeds = np.random.SeedSequence(seed).spawn(len(sizes))
    moves = {p.way.key: np.subtract(*without_noise(experiment, p)) for p in predictions if sizes}
    several, n = map if executor is None else executor.map, len(sizes)
    blocks: list[Refits] = []
    for block in several(refit, [experiment] * n, [predictions] * n, sizes, seeds, [moves] * n):
        blocks.append(block)
        progress(block.trials)
    keys = [prediction.way.key for prediction in predictions] if blocks else []

    def joined(name: str) -> dict[str, Any]:
        return {key: np.concatenate([getattr(own, name)[key] for own in blocks]) for key in keys}

    return Refits(joined("errors"), joined("settled"), joined("cost"))


def _block_sizes(experiment: SimulatedExperiment, trials: int) -> list[int]:
    """Trials of each block; of the plan alone, so that no number depends on the machine."""
    numbers = experiment.weights[..., 0].size * len(experiment.nominal)
    most = max(1, min(MOST_TRIALS, _MOST_NUMBERS // numbers))
    return [min(most, trials - start) for start in range(0, trials, most)]
