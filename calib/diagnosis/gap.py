"""How far the error shrinks once the effects are in the model: fitted poses, and poses held out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, IntArray
from calib.diagnosis.stage import Fit, Stage
from calib.identification.noise_level import believed_sigma
from calib.poses import Measurements, Poses
from calib.scatter import Variances, scatter_of

_DRAWS = 2000
_FEWEST = 3  # groups to draw from
_CLOSED = 1.25  # times the floor: parameters estimated from few poses add to the noise


@dataclass(frozen=True)
class Gap:
    """3-D root mean squares per point, m; None where nothing was held out.

    closed : share of the gap that is gone on held-out poses, None where there was none
    closed_ci95 : bootstrap over configurations, or over blocks of time where effects of time were found
    open : whether the held-out error after stays above the floor beyond chance, by a quarter and more
    over_time : (before, after) at blocks of time that the parameters never saw, where such were found
    """

    floor: float
    fit_before: float
    fit_after: float
    heldout_before: float | None
    heldout_after: float | None
    closed: float | None
    closed_ci95: tuple[float, float] | None
    open: bool = False
    over_time: tuple[float, float] | None = None


def squared_errors(fit: Fit, data: Measurements) -> Array:
    """Squared distance of measured and predicted points, shape (m, C), m^2, NaN where hidden."""
    lengths = fit.model.readout.channels.lengths
    error = (fit.model.off(fit.values, data) ** 2 * lengths).sum(axis=-1)
    return np.where(data.seen & lengths.any(axis=-1), error, np.nan)


def rms(squared: Array) -> float:
    """Root mean square over the visible points, m.

    squared : ndarray, shape (m, M), m^2, NaN for hidden markers
    """
    return float(np.sqrt(np.nanmean(squared)))


def gap_of(
    before: Fit,
    after: Fit,
    data: Measurements,
    heldout: Measurements | None,
    floor: float,
    reach: float,
    by_time: bool = False,
) -> Gap:
    """Both models on both sets; the choice of effects never saw the held-out points.

    reach : float, m, the error of a perfect model: that of the instrument, and of an arm that scatters
    by_time : whether readings close in time err together, so that the interval rests on blocks of time
    """
    fitted = rms(squared_errors(before, data)), rms(squared_errors(after, data))
    if heldout is None:
        return Gap(floor, *fitted, None, None, None, None)
    first, second = (squared_errors(fit, heldout) for fit in (before, after))
    closed = share_closed(first, second, floor)
    poses = heldout.poses
    group = (
        blocks_of_time(poses, max(2, round(len(poses) ** 0.5))) if by_time else poses.configuration
    )
    interval = None if closed is None else _interval(first, second, floor, group)
    still_open = _lower(second, group) > (_CLOSED * reach) ** 2
    return Gap(floor, *fitted, rms(first), rms(second), closed, interval, still_open)


def reach(stage: Stage, fit: Fit, heldout: Measurements | None) -> float:
    """Error of a perfect model at poses held out, 3-D RMS per point, m; zero where there are none.

    The instrument's noise, and the repeatability of the arm.
    """
    if heldout is None or not heldout.seen.any():
        return 0.0
    kept = ~stage.dropped
    channels = stage.model.readout.channels
    believed = believed_sigma(stage.data.take(kept), stage.weights[kept], channels.lengths)
    sigma = believed * fit.variances.scale
    none = Variances.none(fit.model.robot.dof)
    arm = scatter_of(fit.model, fit.values, heldout.poses, none)
    squares = arm.point_variance(fit.variances.approach)[heldout.seen]
    return float(np.sqrt(channels.numbers_each(heldout.seen) * sigma**2 + squares.mean()))


def share_closed(before: Array, after: Array, floor: float) -> float | None:
    """``(before^2 - after^2) / (before^2 - floor^2)``; None where before is not above the floor."""
    first, second = float(np.nanmean(before)), float(np.nanmean(after))
    return (first - second) / (first - floor**2) if first > floor**2 else None


def blocks_of_time(poses: Poses, count: int) -> IntArray:
    """Numbers (m,) of blocks of consecutive readings, equal in size."""
    order = np.argsort(poses.clock, kind="stable")
    block = np.empty(len(poses), dtype=int)
    block[order] = np.arange(len(poses)) * count // len(poses)
    return block


def _lower(squared: Array, group: IntArray) -> float:
    """Below which the mean square lies once in forty, groups drawn whole; zero for too few of them."""
    count = int(group.max()) + 1
    if count < _FEWEST:
        return 0.0
    points = np.bincount(group, np.isfinite(squared).sum(axis=1), count)
    sums = np.bincount(group, np.nansum(squared, axis=1), count)
    drawn = np.random.default_rng(0).integers(0, count, (_DRAWS, count))
    return float(np.quantile(sums[drawn].sum(axis=1) / points[drawn].sum(axis=1), 0.025))


def _interval(
    before: Array, after: Array, floor: float, group: IntArray
) -> tuple[float, float] | None:
    """95 % interval, groups of poses drawn whole and alike for both models."""
    count = int(group.max()) + 1
    if count < _FEWEST:
        return None
    points = np.bincount(group, np.isfinite(before).sum(axis=1), count)
    first, second = (np.bincount(group, np.nansum(s, axis=1), count) for s in (before, after))
    drawn = np.random.default_rng(0).integers(0, count, (_DRAWS, count))
    n = points[drawn].sum(axis=1)
    mean_first, mean_second = first[drawn].sum(axis=1) / n, second[drawn].sum(axis=1) / n
    usable = mean_first > floor**2
    if usable.mean() < 0.5:
        return None
    shares = (mean_first - mean_second)[usable] / (mean_first - floor**2)[usable]
    low, high = np.quantile(shares, [0.025, 0.975])
    return float(low), float(high)
