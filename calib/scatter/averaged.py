"""Scatter that readings neither show nor rule out: averaged over, where none was found.

A variance that enters only where it pays is zero too often, and intervals that believe it are too short
(bias after a pretest). So one size of scatter, of the tip or of all turning joints alike, has a prior
and the restricted likelihood as its weight (integrated restricted likelihood, on a grid). The prior is
half-Cauchy (Gelman, Bayesian Analysis 1(3), 2006) with the scale of the best arms of that size by their
data sheets, cut off at the worst.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from calib.arm.repeatability import Usual
from calib.arrays import Array
from calib.scatter.poses import Scatter
from calib.scatter.restricted import Turned, likelihood
from calib.scatter.variances import Variances

_POINTS = 24
_FAINT = 0.05  # of the instrument's noise: what scatters by less adds nothing


@dataclass(frozen=True, eq=False)
class Unnoticed:
    """What the arm scatters by on average over what is likely.

    variances : Variances; freedom : float, degrees of freedom of what the arm adds, one at least
    """

    variances: Variances
    freedom: float


def unnoticed(scatter: Scatter, problem: Turned, usual: Usual, scale: float) -> Unnoticed | None:
    """Of readings in which no scatter was found; None where no arm would show beside this instrument.

    problem : as :func:`calib.scatter.search.problem_of` gives it
    scale : actual over stated standard deviation of the instrument
    """
    count = scatter.joints + 2
    arm = slice(1, 1 + count)
    faint = _FAINT * scale * float(np.sqrt(problem.units[arm][-2]))
    if faint >= usual.worst:
        return None
    sizes = np.append(0.0, np.geomspace(faint, usual.worst, _POINTS))
    widths = np.diff(sizes, append=sizes[-1]) / 2.0 + np.diff(sizes, prepend=0.0) / 2.0
    prior = widths / (1.0 + (sizes / usual.best) ** 2)
    squares, shapes = sizes**2, np.array(list(_shapes(scatter)))
    theta = np.zeros(len(problem.units))
    theta[0] = scale**2

    def value(variances: Array) -> float:
        theta[arm] = variances / problem.units[arm]
        return likelihood(problem, theta).value

    values = np.array([[value(s * shape) for s in squares] for shape in shapes])
    weights = prior * np.exp(-0.5 * (values - values.min()))
    weights /= weights.sum()
    mean, square = float((weights @ squares).sum()), float((weights @ squares**2).sum())
    freedom = 2.0 * mean**2 / max(square - mean**2, 1e-300)
    added = Variances(scale, (weights @ squares) @ shapes, np.zeros(count))
    return Unnoticed(added, max(1.0, freedom))


def _shapes(scatter: Scatter) -> Iterator[Array]:
    """Variances (n + 2,) of arms whose tip scatters by one: at the tip, and in all turning joints."""
    tip = np.zeros(scatter.joints + 2)
    tip[-2] = 1.0
    turning = np.zeros(scatter.joints + 2)
    turning[: scatter.joints] = scatter.tip[:, 3:, : scatter.joints].any(axis=(0, 1))
    for shape in (tip, turning):
        moved = scatter.of_tip(shape).translation
        if moved > 0.0:
            yield shape / moved**2
