"""Trials identified as real data are: from nothing but the readings, outliers and noise judged.

The refits of a Monte Carlo study know what real data do not: where the base stands, that no pose is
wrong, how large the noise is. So a share of the trials goes the whole way, and must end where their
refits end.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

import calib
from calib.arrays import Array
from calib.cell import Cell
from calib.errors import CalibError, InputError
from studies.compare.experiment import POINTS, Experiment, Way
from studies.compare.prediction import Prediction

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
    cell: Cell, experiment: Experiment, prediction: Prediction, points: Array, refitted: Array
) -> FromScratch | None:
    """Identify one trial; None where the plan leaves parameters open.

    points : ndarray, shape (m, M, 3), m; refitted : ndarray, shape (p,), SI, what its refit found

    Raises InputError where identification refuses them: readings that were drawn hold no mistake.
    """
    if np.isnan(prediction.std).any():
        return None
    way = prediction.way
    try:
        found = calib.identify(
            replace(cell, size_prior="off"),
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
    off = (found.values - refitted) / prediction.std
    correlation = prediction.covariance / np.outer(prediction.std, prediction.std)
    values, vectors = np.linalg.eigh(correlation)
    free = values > 1e-9
    white = (off @ vectors[:, free]) / np.sqrt(values[free])
    apart = float(np.sqrt((white**2).mean()))
    outliers = int(found.fit.outlier.sum())
    whole = way == POINTS and experiment.arm is None
    left_p = found.noise.lack_of_fit_p if whole else None
    return FromScratch(apart, outliers, found.noise.source, left_p)


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
