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
from studies.compare.experiment import POINTS, Experiment, Way
from studies.compare.prediction import Prediction

MOST = 20
"""Trials of a plan that are identified from scratch; each takes as long as a hundred refits."""
_ONE_IN = 20
_OTHERS = 5  # for approach #1, which judges by the same points, this many times fewer
SAME = 0.1
"""Standard deviations, RMS over the directions, within which two fits end at one place."""


@dataclass(frozen=True)
class FromScratch:
    """One trial as real data.

    apart : float, how far it ended from its refit, in standard deviations, RMS over the directions
    outliers : int, poses that it set aside; noise : str, what it took the noise from
    """

    apart: float
    outliers: int
    noise: str

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
    """
    if np.isnan(prediction.std).any():
        return None
    way = prediction.way
    found = calib.identify(
        replace(cell, size_prior="off"),
        experiment.measured(points),
        approach=way.approach,
        weighting=way.weighting,
        length=experiment.length,
    )
    off = (found.values - refitted) / prediction.std
    correlation = prediction.covariance / np.outer(prediction.std, prediction.std)
    values, vectors = np.linalg.eigh(correlation)
    free = values > 1e-9
    white = (off @ vectors[:, free]) / np.sqrt(values[free])
    apart = float(np.sqrt((white**2).mean()))
    return FromScratch(apart, int(found.fit.outlier.sum()), found.noise.source)


def surprising(done: Sequence[FromScratch]) -> tuple[bool, bool]:
    """Whether too many ended elsewhere, and whether too many found other noise than the cell's.

    One in a hundred is set apart, and one in fifty judged noisy or quiet, by the tests' own chance.
    """
    from scipy.special import bdtrc

    def rare(count: int, rate: float) -> bool:
        return count > 0 and float(bdtrc(count - 1, len(done), rate)) < 1e-3

    return (
        rare(sum(not own.same for own in done), 0.01),
        rare(sum(own.noise != "cell" for own in done), 0.02),
    )
