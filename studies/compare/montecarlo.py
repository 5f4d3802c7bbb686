"""Simulated measurements and full refits, many at once.

A trial is drawn from the full model, equilibrium iterated, and fitted by the search that identifies
real data. Trials come in blocks of array operations; each block has a seed of its own, so figures do
not depend on who computes it, where, or in which order.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future
from contextlib import closing
from dataclasses import dataclass
from queue import SimpleQueue
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib.identify.solver import levenberg_marquardt
from calib.se3 import Array
from calib.threads import one_blas_thread
from studies.compare.engines import interrupts_in
from studies.compare.experiment import Experiment
from studies.compare.prediction import Prediction

MOST_TRIALS = 50  # a block: enough for array operations to pay, few enough to stay in the cache
_MOST_NUMBERS = 4_000_000  # entries of the derivatives of one block

Block = dict[str, tuple[Array, NDArray[np.bool_]]]
"""Way -> errors of its estimates (trials, p), SI, and whether each search settled (trials,)."""


@dataclass(frozen=True, eq=False)
class Refits:
    """What the trials of one plan found.

    errors : dict, way -> ndarray, shape (trials, p), SI, estimate minus truth; zero for parameters that
        the plan leaves open
    settled : dict, way -> ndarray of bool, shape (trials,)
    asked : int, trials that were wanted; fewer are there after an interruption
    """

    errors: dict[str, Array]
    settled: dict[str, NDArray[np.bool_]]
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
) -> Block:
    """Draw readings and estimate the parameters of each, by every way from the same readings."""
    model, truth = experiment.model, experiment.truth
    exact = model.predict(truth, experiment.poses)
    white = np.random.default_rng(seed).standard_normal((trials, *exact.shape, 1))
    points = exact + (np.linalg.pinv(experiment.weights) @ white)[..., 0]
    found = {}
    for prediction in predictions:
        observation, start = experiment.observe(prediction.way, points)
        best = levenberg_marquardt(observation.flat, start, prediction.span)
        errors = np.where(np.isnan(prediction.std), 0.0, best.values - truth)
        found[prediction.way.key] = errors, best.converged
    return found


def refits(
    experiment: Experiment,
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

    An interruption (KeyboardInterrupt) ends the study; what is done is kept.
    Figures do not depend on the executor, on machines of one kind to the last digit.
    """
    sizes = _block_sizes(experiment, trials)
    seeds = np.random.SeedSequence(seed).spawn(len(sizes))
    jobs = [(experiment, predictions, size, own) for size, own in zip(sizes, seeds, strict=True)]
    done: dict[int, Block] = {}
    try:
        with closing(_blocks(jobs, executor)) as blocks:
            for index, block in blocks:
                done[index] = block
                progress(sizes[index])
    except KeyboardInterrupt:
        pass
    ordered = [done[index] for index in sorted(done)]
    keys = [prediction.way.key for prediction in predictions] if ordered else []
    return Refits(
        {key: np.concatenate([block[key][0] for block in ordered]) for key in keys},
        {key: np.concatenate([block[key][1] for block in ordered]) for key in keys},
        trials,
    )


def _block_sizes(experiment: Experiment, trials: int) -> list[int]:
    """Trials of each block; of the plan alone, so that no number depends on the machine."""
    numbers = experiment.seen.size * 3 * len(experiment.nominal)
    most = max(1, min(MOST_TRIALS, _MOST_NUMBERS // numbers))
    return [min(most, trials - start) for start in range(0, trials, most)]


def _blocks(jobs: list[tuple[Any, ...]], executor: Executor | None) -> Generator[tuple[int, Block]]:
    if executor is None:
        for index, job in enumerate(jobs):
            yield index, refit(*job)
        return
    done: SimpleQueue[Future[Block] | None] = SimpleQueue()  # None is an interruption
    futures: dict[Future[Block], int] = {}
    with interrupts_in(done):
        try:
            for index, job in enumerate(jobs):
                future = executor.submit(refit, *job)
                futures[future] = index
                future.add_done_callback(done.put)
            for _ in jobs:
                ready = done.get()
                if ready is None:
                    raise KeyboardInterrupt
                yield futures[ready], ready.result()
        except BrokenExecutor:
            raise  # the pool is ending its blocks; it stumbles over one that is cancelled meanwhile
        except BaseException:
            for future in futures:
                future.cancel()
            raise
