"""How far the error shrinks once the effects are in the model: fitted poses, and poses held out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, IntArray, stacked
from calib.diagnosis.candidates import Candidate
from calib.diagnosis.search import Outcome
from calib.diagnosis.stage import Fit
from calib.diagnosis.state import with_curves
from calib.observations.linear import orthonormal
from calib.poses import Measurements, Poses

_DRAWS = 2000
_FEWEST = 3  # groups to draw from
_SURELY, _MUCH = 2.5, 1.25  # standard errors, and times what is expected


@dataclass(frozen=True)
class Gap:
    """3-D root mean squares per point, m; None where nothing was held out.

    closed : share of the gap that is gone on held-out poses, None where there was none
    closed_ci95 : bootstrap over configurations, or over blocks of time where effects of time were found
    heldout_rose : whether the held-out error is not smaller with what was found, None where nothing was
    crossed : (before, after) at fitted configurations that are left out in turn, all that was found
        fitted anew without them; None where nothing was
    over_time : the same at blocks of time, where something depends on time
    """

    floor: float
    fit_before: float
    fit_after: float
    heldout_before: float | None
    heldout_after: float | None
    closed: float | None
    closed_ci95: tuple[float, float] | None
    heldout_rose: bool | None = None
    crossed: tuple[float, float] | None = None
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
    by_time: bool = False,
) -> Gap:
    """Both models on both sets; the choice of effects never saw the held-out points.

    by_time : whether readings close in time err together, so that the interval rests on blocks of time
    """
    fitted = rms(squared_errors(before, data)), rms(squared_errors(after, data))
    if heldout is None:
        return Gap(floor, *fitted, None, None, None, None)
    first, second = (squared_errors(fit, heldout) for fit in (before, after))
    mean, rest = float(np.nanmean(first)), float(np.nanmean(second))
    closed = (mean - rest) / (mean - floor**2) if mean > floor**2 else None
    poses = heldout.poses
    group = (
        blocks_of_time(poses, max(2, round(len(poses) ** 0.5))) if by_time else poses.configuration
    )
    interval = None if closed is None else _interval(first, second, floor, group)
    errors = rms(first), rms(second)
    found = len(after.model.effects) > len(before.model.effects)
    rose = errors[1] >= errors[0] if found else None
    return Gap(floor, *fitted, *errors, closed, interval, rose)


def beyond_noise(after: Fit, heldout: Measurements, expected: float) -> float | None:
    """What held-out poses err by beyond the instrument, m per coordinate; None where not surely more.

    expected : 3-D RMS, m, of noise and scatter; what the parameters' uncertainty adds is added here
    """
    squares = squared_errors(after, heldout)
    _, J = after.model.jacobian(after.values, heldout.poses)
    channels = after.model.readout.channels
    by_parameters = np.einsum("mcrp,pq,mcrq->mcr", J, after.covariance, J) * channels.lengths
    promised = by_parameters.sum(axis=-1) + expected**2
    group = heldout.poses.configuration
    count = int(group.max()) + 1
    each = np.bincount(group, np.nansum(squares - promised, axis=1), count)
    surely = count >= _FEWEST and each.mean() > _SURELY * each.std() / np.sqrt(count)
    ratio = np.nanmean(squares) / promised[heldout.seen].mean()
    if not surely or ratio < _MUCH**2:
        return None
    more = float(np.nanmean(squares) - promised[heldout.seen].mean())
    return float(np.sqrt(more / channels.numbers_each(heldout.seen)))


def blocks_of_time(poses: Poses, count: int) -> IntArray:
    """Numbers (m,) of blocks of consecutive readings, equal in size."""
    order = np.argsort(poses.clock, kind="stable")
    block = np.empty(len(poses), dtype=int)
    block[order] = np.arange(len(poses)) * count // len(poses)
    return block


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


def shares_of(outcome: Outcome, after: Fit, scale: float) -> dict[str, float]:
    """The share of each cause in the unmodelled error, by its key.

    It is the rise of the sum of squares without the cause, over what was there beyond noise. Where
    whole poses scatter, rows weighed by it show hardly anything of what was there before: then rows
    count in deviations of the instrument alone, and scatter is a part of what is left. The error that
    was there is ``r0 = r + sum of x``, x what each cause does beside the user's model and r, across all
    of them, what is left; so ``|r0|^2 = |r|^2 + sum of x . r0``.

    after : Fit, in full; scale : float, actual over the deviation that it weighs by
    """
    fit, active = outcome.fit, outcome.active
    if after.variances.any and active:
        before = fit.without([c.effect for c in active])
        base = orthonormal(stacked(before.J) @ before.span)
        added = _added(fit, active, fit.r.ravel(), stacked(fit.J), base, scale)
        return {key: max(share, 0.0) for key, share in added.items()}
    excess = outcome.before.cost - min(after.cost, after.dof * scale**2)
    if excess <= 0.0:
        return {}
    cov = fit.by_instrument.covariance
    return {c.key: _rise(fit, cov, with_curves(c, active)) / excess for c in active}


def _rise(fit: Fit, cov: Array, gone: Sequence[Candidate]) -> float:
    """By how much the sum of squares rises to first order where some causes are at nothing."""
    own = np.concatenate([fit.model.amounts(c.effect) for c in gone])
    std = np.sqrt(np.diag(cov)[own])
    own = own[std > 0.0]  # the others are not determined
    values, std = fit.values[own] / std[std > 0.0], std[std > 0.0]
    correlation = cov[np.ix_(own, own)] / np.outer(std, std)
    return float(values @ np.linalg.pinv(correlation, hermitian=True) @ values)


def _added(
    fit: Fit, active: Sequence[Candidate], r: Array, J: Array, base: Array, scale: float
) -> dict[str, float]:
    """Shares ``x . r0`` of the squared error that was there beyond noise; nothing where none was.

    r : ndarray, shape (N,), J : ndarray, shape (N, p), rows of the fit; base : ndarray, shape (N, k),
        orthonormal, of what the user's model follows
    """
    own = {c.key: fit.positions(c.effect) for c in active}
    moved = {key: J[:, at] @ fit.moving[at] for key, at in own.items()}
    moved = {key: x - base @ (base.T @ x) for key, x in moved.items()}
    r = r - base @ (base.T @ r)
    before = r + np.sum(list(moved.values()), axis=0)
    noise = min(float(r @ r), fit.dof * scale**2)
    excess = float(before @ before) - noise
    if excess <= 0.0 or not any(len(at) for at in own.values()):
        return {}
    return {key: float(x @ before) / excess for key, x in moved.items()}
