"""Simulated experiments and full refits, and chi-square tests of a prediction by them.

A trial is drawn from the full model, equilibrium iterated, and fitted by the search that identifies
real data. Trials come in blocks of array operations; each block has a seed of its own, so that figures
do not depend on who computes it, where, or in which order.
"""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from calib.arrays import Array
from calib.errors import InputError
from calib.solver import levenberg_marquardt
from calib.threads import one_blas_thread
from studies.compare.experiment import Prediction, SimulatedExperiment

MOST_TRIALS = 50  # a block: enough for array operations to pay, few enough to stay in the cache
_MOST_NUMBERS = 4_000_000  # entries of the derivatives of one block
_PATIENCE_S = 6  # until a scheduler answers
_RANK = 1e-9  # eigenvalue of the correlation matrix below which a direction is fixed


@dataclass(frozen=True, eq=False)
class Refits:
    """The fits of many trials by one way.

    errors : ndarray, shape (trials, p), SI, estimate minus truth; zero for parameters left open
    settled : ndarray of bool, shape (trials,); cost : ndarray, shape (trials,), weighted squares left
    """

    errors: Array
    settled: NDArray[np.bool_]
    cost: Array


@one_blas_thread
def refit(
    experiment: SimulatedExperiment,
    predictions: Sequence[Prediction],
    trials: int,
    seed: np.random.SeedSequence,
    moves: Mapping[str, Array],
) -> dict[str, Refits]:
    """Draw readings and estimate the parameters of each, by every way from the same readings.

    moves : way -> ndarray, shape (p,), SI, by how much readings without noise move the estimate
    """
    points = experiment.drawn(trials, np.random.default_rng(seed))
    done = {}
    for prediction in predictions:
        key = prediction.way.key
        observation, start = experiment.observe(prediction.way, points)
        best = levenberg_marquardt(observation.flat, start + moves[key], prediction.span)
        errors = np.where(np.isnan(prediction.std), 0.0, best.values - experiment.truth)
        done[key] = Refits(errors, best.converged, best.cost)
    return done


def refits(
    experiment: SimulatedExperiment,
    predictions: Sequence[Prediction],
    trials: int,
    *,
    seed: int | Sequence[int] = 0,
    executor: Executor | None = None,
    progress: Callable[[int], None] = lambda _: None,
) -> dict[str, Refits]:
    """Monte Carlo study of one plan: way -> its fits; nothing without trials.

    seed : int, or several; executor : where blocks are computed, here without one
    progress : called with the number of trials that were just done

    Figures do not depend on the executor, on machines of one kind to the last digit.
    """
    numbers = experiment.weights[..., 0].size * len(experiment.nominal)
    most = max(1, min(MOST_TRIALS, _MOST_NUMBERS // numbers))
    sizes = [min(most, trials - start) for start in range(0, trials, most)]
    seeds = np.random.SeedSequence(seed).spawn(len(sizes))
    exact = experiment.model.predict(experiment.truth, experiment.poses)
    moves = {}
    for prediction in predictions if sizes else ():
        observation, start = experiment.observe(prediction.way, exact)
        best = levenberg_marquardt(observation.flat, start, prediction.span)
        moves[prediction.way.key] = best.values - start
    several, n = map if executor is None else executor.map, len(sizes)
    blocks = []
    for block in several(refit, [experiment] * n, [predictions] * n, sizes, seeds, [moves] * n):
        blocks.append(block)
        progress(len(next(iter(block.values())).cost))

    return {
        key: Refits(
            np.concatenate([block[key].errors for block in blocks]),
            np.concatenate([block[key].settled for block in blocks]),
            np.concatenate([block[key].cost for block in blocks]),
        )
        for key in moves
    }


class SimulatedScatter(NamedTuple):
    """Trials beside a prediction.

    std : ndarray, shape (p,), SI, of the trials about their mean, NaN where open
    worst_ratio : float, of it to the predicted one, farthest from one
    p : float, probability of so large a disagreement by chance, over all tests made (Bonferroni)
    """

    std: Array
    worst_ratio: float
    p: float


def agreement(
    errors: Array, covariance: Array, cost: Array | None = None, spare: int = 0
) -> SimulatedScatter | None:
    """Judge trials by a predicted covariance; None from fewer than two.

    With errors e of T trials, their mean m and the covariance C of rank k, chi-square are: the scatter
    ``sum (e - m)^T C^-1 (e - m)`` with (T - 1) k degrees of freedom, that of each parameter alone with
    T - 1, and the bias ``T m^T C^-1 m`` with k.

    errors : ndarray, shape (trials, p), SI; covariance : ndarray, shape (p, p), SI
    cost : ndarray, shape (trials,), squares that each fit leaves, with ``spare`` degrees of freedom
    """
    from scipy.special import chdtrc

    trials, variance = len(errors), np.diag(covariance)
    known = variance > 0.0
    if trials < 2 or not known.any():
        return None
    predicted = np.where(known, np.sqrt(variance), np.nan)
    std = np.where(known, errors.std(axis=0, ddof=1), np.nan)
    scaled, scale = errors[:, known] / predicted[known], np.outer(*[predicted[known]] * 2)
    values, vectors = np.linalg.eigh(covariance[np.ix_(known, known)] / scale)
    free = values > _RANK
    whitened = scaled @ vectors[:, free] / np.sqrt(values[free])
    mean, k = whitened.mean(axis=0), whitened.shape[1]
    alone = [_two_sided((trials - 1) * v, trials - 1) for v in scaled.var(axis=0, ddof=1)]
    tests = [
        _two_sided(float(((whitened - mean) ** 2).sum()), (trials - 1) * k),
        float(chdtrc(k, trials * (mean**2).sum())),
        len(alone) * min(alone),
    ]
    if cost is not None and spare > 0:
        tests.append(_two_sided(float(cost.sum()), trials * spare))
    ratio = (std / predicted)[known]
    worst = float(ratio[np.abs(np.log(ratio)).argmax()])
    return SimulatedScatter(std, worst, min(1.0, len(tests) * min(tests)))


def _two_sided(value: float, dof: int) -> float:
    """Probability of a chi-square as far from its expectation, on either side."""
    from scipy.special import chdtr, chdtrc

    return 2.0 * min(float(chdtr(dof, value)), float(chdtrc(dof, value)))


@contextmanager
def engine(workers: int = 1, scheduler: str | None = None) -> Iterator[Executor | None]:
    """An executor, shut down at the end; None means: in this process.

    Raises InputError where the scheduler cannot be reached, dask is not installed or a worker died.
    """
    if scheduler is not None:
        try:
            from distributed import Client

            client = Client(scheduler, timeout=_PATIENCE_S)
        except ImportError:
            remedy = "pip install 'posecal[cluster]'"
            raise InputError("--scheduler", "", "dask is not installed", remedy) from None
        except (OSError, ValueError):
            remedy = "start one, or leave it out"
            raise InputError("--scheduler", scheduler, "no scheduler answers", remedy) from None
        with client:
            yield client.get_executor(pure=False)
    elif workers > 1:
        ignore = (signal.SIGINT, signal.SIG_IGN)
        try:
            with ProcessPoolExecutor(workers, get_context("spawn"), signal.signal, ignore) as pool:
                yield pool
        except BrokenProcessPool:
            what = "a worker died, perhaps out of memory"
            raise InputError("--workers", str(workers), what, "take fewer") from None
    else:
        yield None
