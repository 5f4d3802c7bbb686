"""The test whether repeated readings moved, and whether steadily.

Nothing but the readings enters, and how the arm returns. Displacements of the markers between readings
at equal joints fall into three parts, each a sum of squares under the noise of instrument and arm: what
a steady rigid motion of the station against the base explains (base drift and instrument drift alike),
what other rigid motions explain, one for each reading (the arm returns worse than that, or something
was knocked), and what is left, the noise of single points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from calib.arm.repeatability import usual_repeatability
from calib.arrays import Array
from calib.cell import Cell
from calib.drift.series import Series, columns_about, flat, inverse, series_of
from calib.identification import Identification
from calib.identification.start import whitening
from calib.model import Model
from calib.observations import Points
from calib.observations.shape import rigid_motions
from calib.poses import Measurements
from calib.scatter import Scatter, Variances, scatter_of, unnoticed
from calib.scatter.search import problem_of, searched

Verdict = Literal["steady", "drift", "moved"]

_ROUNDING = 1e-9
_MANY = 12  # degrees of freedom that tell a level
_SURE = 0.01  # p value below which something moved, or the noise is more than stated


@dataclass(frozen=True, eq=False)
class Rate:
    """Steady motion of the readings in a station's frame, at the mean of the repeated points.

    translation, translation_std : ndarray, shape (3,), m/s
    rotation, rotation_std : ndarray, shape (3,), rad/s
    """

    translation: Array
    translation_std: Array
    rotation: Array
    rotation_std: Array


@dataclass(frozen=True, eq=False)
class DriftTest:
    """Result of the test of repeated readings for motion over time.

    verdict : "steady", "drift" (with time), or "moved" (most of it without a trend, or too few
        readings to tell)
    series : tuple of Series, the one with most readings first
    p : float, probability of so much motion under the noise alone; dof : int, behind it
    trend_p : float, the same for its steady part, against the rest where that is more than noise; NaN
        where nothing is left to judge it by
    noise_factor : float, noise of single points over what is stated, 1 where they agree
    rates : dict, station -> Rate, empty where no time is given
    """

    verdict: Verdict
    series: tuple[Series, ...]
    p: float
    dof: int
    trend_p: float
    noise_factor: float
    rates: dict[str, Rate]

    @property
    def one_side(self) -> bool:
        """Whether no joint came from different sides: then backlash is not what moved the readings."""
        return all(one.one_side for one in self.series)


@dataclass(frozen=True)
class _Part:
    """A sum of squares in units of the noise's variance, and its degrees of freedom."""

    sum: float
    dof: int

    @property
    def mean(self) -> float:
        return self.sum / self.dof

    def p(self, against: _Part | None) -> float:
        """Of so large a sum under the noise as stated, or (F) as another part shows it."""
        from scipy.special import chdtrc, fdtrc

        if not self.dof:
            return 1.0
        if against is None:
            return float(chdtrc(self.dof, self.sum))
        if not against.mean:  # readings that repeat to the last digit
            return float(not self.sum)
        return float(fdtrc(self.dof, against.dof, self.mean / against.mean))


def drift_of(data: Measurements, weights: Array, arm: Scatter | None = None) -> DriftTest | None:
    """Judge the readings that were repeated after the arm had been elsewhere; None without any
    that share a marker.

    weights : ndarray, shape (m, M, 3, 3), 1/m, whitening matrices of the points, zero where hidden
    arm : Scatter, how the arm returns to the poses; None where it returns exactly
    """
    series = series_of(data, weights, arm)
    parts = [_moved_and_rest(one) for one in series]
    moved = _Part(sum(m.sum for m, _ in parts), sum(m.dof for m, _ in parts))
    if not moved.dof:
        return None
    rest = _Part(sum(r.sum for _, r in parts), sum(r.dof for _, r in parts))
    noise = rest if rest.p(None) < _SURE else None
    trends = {
        station: _trend([one for one in series if one.station == station])
        for station in dict.fromkeys(one.station for one in series)
    }
    steady = _Part(
        sum(t.part.sum for t in trends.values()), sum(t.part.dof for t in trends.values())
    )
    other = _Part(max(moved.sum - steady.sum, 0.0), moved.dof - steady.dof)
    # A drift makes the arm's own level look larger: beside an arm the rest is what tells.
    beyond = other.p(noise) < _SURE
    scatter = other if beyond or (arm is not None and other.dof >= _MANY) else noise
    p, trend_p = moved.p(noise), steady.p(scatter) if other.dof else np.nan
    # Backlash moves many readings alike: what else moved must not outweigh the trend.
    trend = trend_p < _SURE and (not beyond or steady.sum > other.sum)
    return DriftTest(
        "drift" if trend else "moved" if p < _SURE else "steady",
        tuple(series),
        p,
        moved.dof,
        trend_p,
        1.0 if noise is None else float(np.sqrt(noise.mean)),
        {
            data.poses.stations[station]: trend.rate(1.0 if scatter is None else scatter.mean)
            for station, trend in trends.items()
        }
        if series[0].timed
        else {},
    )


def _moved_and_rest(series: Series) -> tuple[_Part, _Part]:
    """What a rigid motion of each reading explains of the deviations, and what it does not.

    The true points are unknowns too: they are eliminated from the normal equations.
    """
    own, d = series.information, flat(series.deviations)
    seen = series.seen
    everything = _Part(
        float(np.einsum("vi,vij,vj->", d, own, d)),
        3 * int(seen.sum() - seen.any(axis=0).sum()),
    )
    largest = own.max()
    columns, _ = columns_about(series.mean, series.mean[seen.any(axis=0)].mean(axis=0))
    weighted = own @ columns
    cov, motions = inverse(columns.T @ weighted)
    own = own - weighted @ cov @ np.swapaxes(weighted, -1, -2)
    pulls = (own @ d[..., None])[..., 0]
    total, pull = own.sum(axis=0), pulls.sum(axis=0)
    if total.max() <= _ROUNDING * largest:  # of a single marker nothing is left
        total = np.zeros_like(total)
    cov, points = inverse(total)
    rest = _Part(
        max(float((d * pulls).sum() - pull @ cov @ pull), 0.0),
        3 * int(seen.sum()) - int(motions.sum()) - int(points),
    )
    return _Part(max(everything.sum - rest.sum, 0.0), everything.dof - rest.dof), rest


@dataclass(frozen=True, eq=False)
class _Trend:
    """A common steady motion (6,), turns times spread, and its covariance for the noise as stated."""

    xi: Array
    cov: Array
    part: _Part
    spread: float

    def rate(self, variance: float) -> Rate:
        std = np.sqrt(np.diag(self.cov) * variance)
        s = self.spread
        return Rate(self.xi[:3], std[:3], self.xi[3:] / s, std[3:] / s)


def _trend(series: Sequence[Series]) -> _Trend:
    """The steady motion that explains most of the deviations of all series of a station."""
    seen = [one.seen.any(axis=0) for one in series]
    points = np.concatenate([one.mean[own] for one, own in zip(series, seen, strict=True)])
    columns, spread = columns_about(points, points.mean(axis=0))
    N, b = np.zeros((6, 6)), np.zeros(6)
    start = 0
    for one, own in zip(series, seen, strict=True):
        shown = np.repeat(own, 3)
        B = columns[start : start + shown.sum()]
        start += int(shown.sum())
        P, d = one.information[:, shown][..., shown], flat(one.deviations)[:, shown]
        time = one.time - one.time.mean()
        weighted = time[:, None, None] * (B.T @ P)
        summed, total = weighted.sum(axis=0), P.sum(axis=0)
        N += (time[:, None, None] * (weighted @ B)).sum(axis=0)
        N -= summed @ np.linalg.solve(total, summed.T)
        b += (weighted @ d[..., None])[..., 0].sum(axis=0)
    cov, rank = inverse(N)
    return _Trend(cov @ b, cov, _Part(float(b @ cov @ b), int(rank)), spread)


def drift_in(cell: Cell, found: Identification, data: Measurements) -> DriftTest | None:
    """What repeated readings of the tracker say; None without a tracker, or where none was repeated.

    data : all that was read, the poses held out included
    How the arm returns is judged beside a steady motion of each station, by restricted likelihood: a
    drift would else count as the arm's, and hide behind it.
    """
    tracked = found.model.tracked(data)
    if tracked is None:
        return None
    model, own = tracked
    weights = whitening(cell, model, found.values, own)
    if drift_of(own, weights) is None:
        return None
    fitted = found.model.tracked(found.fit.data.take(~found.fit.outlier)) or tracked
    arm = scatter_of(model, found.values, own.poses, _arm(cell, found, *fitted))
    return drift_of(own, weights, arm)


def _arm(cell: Cell, found: Identification, model: Model, own: Measurements) -> Variances:
    """How the arm returns by the poses fitted: as found, else on average over what is likely."""
    values, span = found.values, np.eye(len(found.values))[:, found.std > 0.0]
    points = Points(model, own, whitening(cell, model, values, own))
    still = scatter_of(model, values, own.poses, Variances.none(model.robot.dof))
    linear = points.linear(values, span).with_columns(points.rows(_steady(own)))
    levers = points.rows(still.levers)
    problem = problem_of(still, levers, linear, cell.repeatability)
    arm = searched(problem, still).variances
    hidden = None
    if not arm.any and cell.repeatability is None:
        hidden = unnoticed(still, problem, usual_repeatability(model.robot.reach), 1.0)
    if hidden is not None:
        return hidden.variances
    if still.has_approaches:
        return arm
    return Variances(arm.scale, arm.approach + arm.configuration, arm.configuration)


def _steady(data: Measurements) -> Array:
    """How the points follow a steady motion of each station, shape (m, M, 3, 6 stations)."""
    poses, seen = data.poses, data.seen
    clock = poses.clock - poses.clock.mean()
    moved = rigid_motions(data.points - data.points[seen].mean(axis=0))
    moved = moved.reshape(*data.points.shape, 6) * seen[..., None, None]
    moved = moved * (clock / (np.abs(clock).max() or 1.0))[:, None, None, None]
    return np.concatenate(
        [moved * (poses.station == s)[:, None, None, None] for s in np.unique(poses.station)],
        axis=-1,
    )
