"""What moves on through the day beside the model, carried on to the targets' time.

A base or an instrument that warms or drifts moves all readings of a station as one rigid body,
``a g(t)`` with six amplitudes a. Which g nobody knows: it is averaged over ``1 - exp(-t / tau)``, from
soon settled to steady, each by its likelihood. A fit without it stands where the day was on average:
at another time it is off by the trend there, less what its values took up.

An F test of the readings alone counts every one of them, and would be fooled where whole poses err
together in other ways than was found. So the stays of the arm are put in other orders as well: what
comes of no trend would as soon come in any of them (Freedman and Lane, J. Bus. Econ. Stat. 1(4), 1983).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, IntArray, stacked
from calib.compensation.unexplained import Fitted
from calib.effects.base import Base
from calib.linear import LinearProblem
from calib.model import Model
from calib.model.covariance import working_points
from calib.poses import Poses
from calib.poses.moves import visits

_SURE = 0.01  # p value below which there is a trend
_TAUS = (0.25, 0.5, 1.0, 2.0, 1e3)  # of the session; the last one is a steady drift
_SHOWN = 1e-6  # of the largest: directions that the readings show less are left out


@dataclass(frozen=True, eq=False)
class DayTrend:
    """How the values are off through the day, for K functions ``1 - exp(-t / tau)`` of the clock.

    taus, weights : ndarray, shape (K,), in units of the session's clock, and how likely each is
    taken, moving : ndarray, shape (K, p), SI, what is off at the first reading, and the amplitudes
    last : of the clock, at the last reading
    """

    taus: Array
    weights: Array
    taken: Array
    moving: Array
    last: float

    def at(self, clock: Array) -> Array:
        """By how much the values are off at times (m,), times the weights' root, shape (m, K, p)."""
        grown = -np.expm1(-np.maximum(clock, 0.0)[:, None] / self.taus)
        off = self.taken + grown[..., None] * self.moving
        return np.asarray(np.sqrt(self.weights)[:, None] * off)

    def errors(self, model: Model, values: Array, targets: Poses, clock: Array) -> Array:
        """What that does to targets at times (m,), RMS over their points, 3-D, shape (m,), m."""
        _, J = working_points(model).jacobian_at_rest(values, targets)
        moved = np.einsum("mjip,mkp->mjik", J, self.at(clock), optimize=True)
        return np.asarray(np.sqrt((moved**2).sum(axis=(-1, -2)).mean(axis=-1)))


def trend_of(fit: Fitted, sure: float = _SURE) -> DayTrend | None:
    """The trend of a residual; None where none is shown, nothing tells the time, or the model has one.

    sure : p value below which there is one: an F test of the best of the functions, each of them tried,
        and the share of other orders of the stays in which as much follows it
    """
    poses, own = fit.data.poses, fit.model.where(Base)
    timed = any("time" in effect.uses for effect in fit.model.effects)
    if timed or not len(own) or not poses.clocked or not np.ptp(poses.clock):
        return None
    taus = np.array(_TAUS) * float(np.ptp(poses.clock))
    grown = -np.expm1(-poses.clock[:, None] / taus)
    problem, moved = fit.linear, fit.linear.J[..., own]
    found = _regressed(problem, moved, grown, visits(poses), sure)
    if found is None:
        return None
    likely, amplitudes = found
    moving = np.zeros((len(taus), len(fit.values)))
    moving[:, own] = amplitudes
    taken = -_taken_up(problem, moved, grown, amplitudes) @ fit.span.T
    return DayTrend(taus, likely, taken, moving, float(poses.clock.max()))


def _regressed(
    problem: LinearProblem, moved: Array, grown: Array, stay: IntArray, sure: float
) -> tuple[Array, Array] | None:
    """How likely each function (m, K) is, and its amplitudes (K, b); None where chance may be all.

    moved : ndarray, shape (m, R, b), how the readings follow the bases; stay : ndarray of int, (m,)
    """
    from scipy.special import fdtrc

    beside = problem.complement

    def followed(g: Array) -> tuple[float, Array, int]:
        """By how much a function (m,) lowers the sum of squares, its amplitudes, and their rank."""
        columns, scale = _unit(problem.columns(moved * g[:, None, None]))
        outside = beside.of(columns)
        found, _, shown, _ = np.linalg.lstsq(outside, beside.left, rcond=_SHOWN)
        return float(beside.left @ outside @ found), found / scale, int(shown)

    each = [followed(g) for g in grown.T]
    falls, rank = np.array([fall for fall, _, _ in each]), max(shown for _, _, shown in each)
    dof = beside.rows - beside.Q.shape[1] - rank
    if not rank or dof <= 0:
        return None
    noise = float(beside.left @ beside.left - falls.max()) / dof
    if noise <= 0.0:  # nothing is left to be explained
        return None
    if min(1.0, len(falls) * float(fdtrc(rank, dof, falls.max() / rank / noise))) > sure:
        return None
    best = grown[:, int(falls.argmax())]
    others = _orders(best, stay, round(1.0 / sure) - 1)
    if any(followed(g)[0] >= falls.max() for g in others):
        return None
    likely = np.exp(0.5 * (falls - falls.max()) / noise)
    return likely / likely.sum(), np.array([amplitudes for _, amplitudes, _ in each])


def _orders(g: Array, stay: IntArray, count: int) -> Iterator[Array]:
    """A function (m,) of the clock in so many other orders of the stays."""
    rng = np.random.default_rng(0)
    _, first, of = np.unique(stay, return_index=True, return_inverse=True)
    for _ in range(count):
        yield g[rng.permutation(first)][of.reshape(-1)]


def _taken_up(problem: LinearProblem, moved: Array, grown: Array, amplitudes: Array) -> Array:
    """How far least squares went along with each function, shape (K, k)."""
    through = np.einsum("mrb,mk,kb->mrk", moved, grown, amplitudes, optimize=True)
    A, scale = _unit(stacked(problem.J @ problem.span))
    return np.asarray((np.linalg.lstsq(A, stacked(through), rcond=_SHOWN)[0] / scale[:, None]).T)


def _unit(columns: Array) -> tuple[Array, Array]:
    """Columns of length one, and their lengths; one for those of zeros."""
    scale = np.linalg.norm(columns, axis=0)
    scale = np.where(scale > 0.0, scale, 1.0)
    return columns / scale, scale
