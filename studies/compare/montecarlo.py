"""Simulated measurements and full refits, many at once.

A trial is drawn from the full model, equilibrium iterated, or from MuJoCo's, and fitted by the search
that identifies real data. The fits start where the robot is thought to be; a share of the trials is
identified from nothing but its readings (:mod:`studies.compare.scratch`). Trials come in blocks of
array operations; each block has a seed of its own, so figures do not depend on who computes it, where,
or in which order.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import closing
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from calib.arrays import Array
from calib.solver import levenberg_marquardt
from calib.threads import one_blas_thread
from studies.compare.experiment import Experiment
from studies.compare.prediction import Prediction
from studies.compare.scratch import FromScratch, from_scratch, share_of
from studies.engines import computed

MOST_TRIALS = 50  # a block: enough for array operations to pay, few enough to stay in the cache
_MOST_NUMBERS = 4_000_000  # entries of the derivatives of one block


class Fits(NamedTuple):
    """What one way made of the trials of a block.

    errors : ndarray, shape (trials, p), SI, of its estimates
    settled : ndarray of bool, shape (trials,)
    cost : ndarray, shape (trials,), weighted sum of squares that is left
    scratch : list of FromScratch, of the trials that were identified from scratch
    """

    errors: Array
    settled: NDArray[np.bool_]
    cost: Array
    scratch: list[FromScratch]


Block: TypeAlias = dict[str, Fits]
"""Way -> what it made of a block's trials."""


@dataclass(frozen=True, eq=False)
class Refits:
    """What the trials of one plan found.

    errors : dict, way -> ndarray, shape (trials, p), SI, estimate minus truth; zero for parameters that
        the plan leaves open
    settled : dict, way -> ndarray of bool, shape (trials,)
    cost : dict, way -> ndarray, shape (trials,), weighted sum of squares that is left
    scratch : dict, way -> list of FromScratch, of the trials that were identified from scratch
    asked : int, trials that were wanted; fewer are there after an interruption
    """

    errors: dict[str, Array]
    settled: dict[str, NDArray[np.bool_]]
    cost: dict[str, Array]
    scratch: dict[str, list[FromScratch]]
    asked: int

    @property
    def trials(self) -> int:
        """Trials that were done."""
        return len(next(iter(self.errors.values()))) if self.errors else 0

    def of(self, way: str) -> Array:
        """Errors of the trials that settled, shape (n, p), SI."""
        return self.errors[way][self.settled[way]]


@one_blas_thread
def refit(
    experiment: Experiment,
    predictions: Sequence[Prediction],
    trials: int,
    seed: np.random.SeedSequence,
    whole: Mapping[str, int],
) -> Block:
    """Draw readings and estimate the parameters of each, by every way from the same readings.

    whole : way -> how many of the trials it identifies from scratch too
    """
    points = experiment.drawn(trials, np.random.default_rng(seed))
    found = {}
    for prediction in predictions:
        observation, start = experiment.observe(prediction.way, points)
        best = levenberg_marquardt(observation.flat, start, prediction.span)
        errors = np.where(np.isnan(prediction.std), 0.0, best.values - experiment.truth)
        scratch = _from_scratch(
            experiment, prediction, points, best.values, whole.get(prediction.way.key, 0)
        )
        found[prediction.way.key] = Fits(errors, best.converged, best.cost, scratch)
    return found


def _from_scratch(
    experiment: Experiment, prediction: Prediction, points: Array, values: Array, count: int
) -> list[FromScratch]:
    if experiment.cell is None:
        return []
    done = (
        from_scratch(experiment.cell, experiment, prediction, own, refitted)
        for own, refitted in zip(points[:count], values[:count], strict=True)
    )
    return [found for found in done if found is not None]


def refits(
    experiment: Experiment,
    predictions: Sequence[Prediction],
    trials: int,
    *,
    seed: int | Sequence[int] = 0,
    executor: Executor | None = None,
    progress: Callable[[int], None] = lambda _: None,
    scratch: int = 0,
) -> Refits:
    """Monte Carlo study of one plan.

    trials : int; seed : int, or several, such as a number for each plan beside the user's
    scratch : int, most of the trials that are identified from scratch too
    executor : where blocks are computed, here without one
    progress : called with the number of trials that were just done

    An interruption (KeyboardInterrupt) ends the study; what is done is kept.
    Figures do not depend on the executor, on machines of one kind to the last digit.
    """
    sizes = _block_sizes(experiment, trials)
    seeds = np.random.SeedSequence(seed).spawn(len(sizes))
    whole = {p.way.key: share_of(p.way, trials, scratch) for p in predictions}
    jobs = [
        (experiment, predictions, size, own, _evenly(whole, index, len(sizes)))
        for index, (size, own) in enumerate(zip(sizes, seeds, strict=True))
    ]
    done: dict[int, Block] = {}
    try:
        with closing(computed(refit, jobs, executor)) as blocks:
            for index, block in blocks:
                done[index] = block
                progress(sizes[index])
    except KeyboardInterrupt:
        pass
    ordered = [done[index] for index in sorted(done)]
    keys = [prediction.way.key for prediction in predictions] if ordered else []
    return Refits(
        {key: np.concatenate([block[key].errors for block in ordered]) for key in keys},
        {key: np.concatenate([block[key].settled for block in ordered]) for key in keys},
        {key: np.concatenate([block[key].cost for block in ordered]) for key in keys},
        {key: [own for block in ordered for own in block[key].scratch] for key in keys},
        trials,
    )


def _evenly(whole: Mapping[str, int], block: int, blocks: int) -> dict[str, int]:
    """One block's part of what is counted over all of them."""
    return {key: len(range(block, count, blocks)) for key, count in whole.items()}


def _block_sizes(experiment: Experiment, trials: int) -> list[int]:
    """Trials of each block; of the plan alone, so that no number depends on the machine."""
    numbers = experiment.weights[..., 0].size * len(experiment.nominal)
    most = max(1, min(MOST_TRIALS, _MOST_NUMBERS // numbers))
    return [min(most, trials - start) for start in range(0, trials, most)]
