"""Simulated measurements and full refits, many at once.

A trial is drawn from the full model, equilibrium iterated, or from MuJoCo's, and fitted by the search
that identifies real data. The fits start where readings without noise lead from the robot as it is
thought to be: they know what real data do not, where the base stands, that no pose is wrong, how large
the noise is. So a share of the trials is identified from nothing but its readings, outliers and noise
judged, and must end where its refits end. Trials come in blocks of array operations; each block has a
seed of its own, so figures do not depend on who computes it, where, or in which order.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import closing
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib.arm.se3 import same_turn
from calib.arrays import Array
from calib.errors import CalibError, InputError
from calib.identification.identify import estimated
from calib.model import Model
from calib.solver import levenberg_marquardt
from calib.threads import one_blas_thread
from studies.compare.experiment import POINTS, SimulatedExperiment, Way
from studies.compare.prediction import Prediction
from studies.engines import computed

MOST = 20
"""Trials of a plan that are identified from scratch; each takes as long as a hundred refits."""
_ONE_IN = 20
_OTHERS = 5  # for approach #1, which judges by the same points, this many times fewer
_RARE = 1e-3  # chance of as much in a program without a fault
_SCORED = (1e-12, 1.0 - 1e-12)  # probabilities whose normal scores are finite
SAME = 0.1
"""Standard deviations, RMS over the directions, within which two fits end at one place."""


@dataclass(frozen=True)
class FromScratch:
    """One trial as real data.

    apart : float, how far it ended from its refit, in standard deviations, RMS over the directions
    outliers : int, poses that it set aside; noise : str, what it took the noise from
    left_p : float, probability of as much as it leaves, by the degrees of freedom that it counts; None
        where residuals are not weighted by all that they come from: the arm's scatter, or approach #1
    """

    apart: float
    outliers: int
    noise: str
    left_p: float | None

    @property
    def same(self) -> bool:
        """Whether both fits ended at one place."""
        return self.apart < SAME


def share_of(way: Way, trials: int, most: int = MOST) -> int:
    """How many of the trials of a plan are identified from scratch."""
    wanted = min(most, -(-trials // _ONE_IN))
    return wanted if way == POINTS else -(-wanted // _OTHERS)


def from_scratch(
    experiment: SimulatedExperiment, prediction: Prediction, points: Array, refitted: Array
) -> FromScratch | None:
    """Identify one trial; None where the plan leaves parameters open, or no cell is known.

    points : ndarray, shape (m, M, 3), m; refitted : ndarray, shape (p,), SI, what its refit found

    Raises InputError where identification refuses them: readings that were drawn hold no mistake.
    """
    if experiment.cell is None or np.isnan(prediction.std).any():
        return None
    way = prediction.way
    try:
        _, _, found = estimated(
            replace(experiment.cell, size_prior="off"),
            experiment.measured(points),
            approach=way.approach,
            weighting=way.weighting,
            length=experiment.length,
        )
    except CalibError as error:
        raise InputError(
            "simulated readings",
            "",
            "identify refuses what posecal drew itself, without a mistake",
            "the program or an added effect is at fault, or these poses mislead it; report it with "
            f"what identify says: {error}",
        ) from None
    ended = _turned_alike(found.model, found.values, refitted)
    off = (ended - refitted) / prediction.std
    correlation = prediction.covariance / np.outer(prediction.std, prediction.std)
    values, vectors = np.linalg.eigh(correlation)
    free = values > 1e-9
    white = (off @ vectors[:, free]) / np.sqrt(values[free])
    apart = float(np.sqrt((white**2).mean()))
    outliers = int((~found.kept).sum())
    whole = way == POINTS and experiment.arm is None
    left_p = found.noise.lack_of_fit_p if whole else None
    return FromScratch(apart, outliers, found.noise.source, left_p)


def _turned_alike(model: Model, values: Array, like: Array) -> Array:
    """The values (p,), a turn by half a circle written as in others: it has two rotation vectors."""
    values, names = values.copy(), [parameter.name for parameter in model.parameters]
    for i, name in enumerate(names):
        if name.endswith("rx") and [own[-2:] for own in names[i : i + 3]] == ["rx", "ry", "rz"]:
            values[i : i + 3] = same_turn(values[i : i + 3], like[i : i + 3])
    return values


def surprising(done: Sequence[FromScratch]) -> tuple[bool, bool, bool]:
    """Whether too many ended elsewhere or found other noise than the cell's, or all leave too much.

    One in a hundred is set apart, and one in fifty judged noisy or quiet, by the tests' own chance.
    What is left is judged over all together (Stouffer): one alone hardly shows that degrees of freedom
    are counted wrongly. Those that set poses aside leave less by choice, and stay out.
    """
    from scipy.special import bdtrc, ndtr, ndtri

    def rare(count: int, rate: float) -> bool:
        return count > 0 and float(bdtrc(count - 1, len(done), rate)) < _RARE

    whole = [own.left_p for own in done if own.left_p is not None and not own.outliers]
    scores = ndtri(np.clip(whole, *_SCORED))
    total = float(scores.sum() / np.sqrt(max(1, len(scores))))

    return (
        rare(sum(not own.same for own in done), 0.01),
        rare(sum(own.noise != "cell" for own in done), 0.02),
        2.0 * float(ndtr(-abs(total))) < _RARE / 10.0,  # miscounting shows by far more
    )


MOST_TRIALS = 50  # a block: enough for array operations to pay, few enough to stay in the cache
_MOST_NUMBERS = 4_000_000  # entries of the derivatives of one block


@dataclass(frozen=True, eq=False)
class Refits:
    """What the trials of one plan found, or those of a block.

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


def without_noise(experiment: SimulatedExperiment, prediction: Prediction) -> tuple[Array, Array]:
    """Where a fit of readings without noise ends, and where it starts, shape (p,) each, SI."""
    observation, start = experiment.observe(prediction.way, experiment.readings())
    return levenberg_marquardt(observation.flat, start, prediction.span).values, start


@one_blas_thread
def refit(
    experiment: SimulatedExperiment,
    predictions: Sequence[Prediction],
    trials: int,
    seed: np.random.SeedSequence,
    moves: Mapping[str, Array],
    whole: Mapping[str, int],
) -> Refits:
    """Draw readings and estimate the parameters of each, by every way from the same readings.

    moves : way -> ndarray, shape (p,), SI, by how much readings without noise move its estimate
    whole : way -> how many of the trials it identifies from scratch too
    """
    points = experiment.drawn(trials, np.random.default_rng(seed))
    found = Refits({}, {}, {}, {}, trials)
    for prediction in predictions:
        key = prediction.way.key
        observation, start = experiment.observe(prediction.way, points)
        best = levenberg_marquardt(observation.flat, start + moves[key], prediction.span)
        errors = best.values - experiment.truth
        found.errors[key] = np.where(np.isnan(prediction.std), 0.0, errors)
        found.settled[key], found.cost[key] = best.converged, best.cost
        count = whole.get(key, 0)
        pairs = zip(points[:count], best.values[:count], strict=True)
        tried = [from_scratch(experiment, prediction, *own) for own in pairs]
        found.scratch[key] = [own for own in tried if own is not None]
    return found


def refits(
    experiment: SimulatedExperiment,
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
    moves = {p.way.key: np.subtract(*without_noise(experiment, p)) for p in predictions if sizes}
    jobs = [
        (experiment, predictions, size, own, moves,
         {key: len(range(index, count, len(sizes))) for key, count in whole.items()})
        for index, (size, own) in enumerate(zip(sizes, seeds, strict=True))
    ]  # fmt: skip
    done: dict[int, Refits] = {}
    try:
        with closing(computed(refit, jobs, executor)) as blocks:
            for index, block in blocks:
                done[index] = block
                progress(sizes[index])
    except KeyboardInterrupt:
        pass
    ordered = [done[index] for index in sorted(done)]
    keys = [prediction.way.key for prediction in predictions] if ordered else []

    def joined(name: str) -> dict[str, Any]:
        return {key: np.concatenate([getattr(own, name)[key] for own in ordered]) for key in keys}

    scratch_of = {key: [one for own in ordered for one in own.scratch[key]] for key in keys}
    return Refits(joined("errors"), joined("settled"), joined("cost"), scratch_of, trials)


def _block_sizes(experiment: SimulatedExperiment, trials: int) -> list[int]:
    """Trials of each block; of the plan alone, so that no number depends on the machine."""
    numbers = experiment.weights[..., 0].size * len(experiment.nominal)
    most = max(1, min(MOST_TRIALS, _MOST_NUMBERS // numbers))
    return [min(most, trials - start) for start in range(0, trials, most)]
