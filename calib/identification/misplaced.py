"""Readings under the wrong joints or names, found by how far the nominal arm misses them.

The nominal arm is laid over some of the readings; a run of poses shifted by one against their joints,
or markers that changed names at some poses, then stand out and come near once that is undone.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from calib.arrays import Array, IntArray, Mask
from calib.identification.start import initial_values, missed_by
from calib.model import Model
from calib.poses import Measurements

_GROSS = 10.0  # times the median miss: a pose beyond it has an error of its own
_ROUNDS = 4
_RIGID = np.array([0, 3, 5, 6])  # coordinates of a body that 0, 1, 2 or more markers fix
_PLACED = 12  # coordinates that base and tool take at most
_SHIFT_POSES, _EXCHANGE_POSES = 40, 60  # that are looked at
_FEWEST = 5  # poses that only the shift explains: a few wrong readings are no shift
_MOST = 0.9  # of the poses must fit, as they are or shifted, and of the run with the shift
_TURNS = 12  # of fit and exchange
_SPARE = 12  # more than these must fit as well: a wrong reading does so by chance never


@dataclass(frozen=True, eq=False)
class Placed:
    """Base and markers under the nominal arm.

    values : ndarray, shape (p,), SI; missed : ndarray, shape (m,), m, root mean square of each pose's
        markers; kept : ndarray of bool, shape (m,), all but gross errors
    spread : float, m, of the points of the poses kept about their middle, RMS
    """

    values: Array
    missed: Array
    kept: Mask
    spread: float

    @property
    def share(self) -> float:
        """RMS misfit over the spread of the points."""
        return self.rms / self.spread if self.spread > 0.0 else np.inf

    @property
    def rms(self) -> float:
        """Root mean square of the poses kept, m."""
        return float(np.sqrt(np.mean(self.missed[self.kept] ** 2)))


def placed(model: Model, data: Measurements, rounds: int = _ROUNDS) -> Placed:
    """Fit base and markers, again without the poses that stand far out as long as those change."""
    seen = np.asarray(data.seen.any(axis=1))
    kept = seen
    for _ in range(rounds):
        values = initial_values(model, data.take(kept))
        missed = missed_by(model, data, values)
        near = seen & (missed <= _GROSS * np.median(missed[kept]))
        if np.array_equal(near, kept):
            break
        kept = near
    points = data.points[kept][data.seen[kept]]
    return Placed(values, missed, kept, float(np.sqrt(points.var(axis=0).sum())))


def some(data: Measurements, count: int) -> Measurements:
    """At most so many of the readings, one of each configuration."""
    _, first = np.unique(data.poses.configuration, return_index=True)
    chosen: IntArray = np.random.default_rng(0).permutation(first)[:count]
    return data.take(np.sort(chosen))


def telling(data: Measurements) -> bool:
    """Whether readings are so many that they do not fit a wrong idea by chance."""
    markers = np.minimum(data.seen.sum(axis=1), 3)
    return bool(_RIGID[markers].sum() >= _PLACED + _SPARE)


# -- points beside their joints --------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Shifted:
    """A run of poses whose points belong to the joints of the next pose, or of the one before.

    by : 1 or -1, how many poses later the joints stand
    run : ndarray of int, poses in the order of measurement, from the first to the last
    before, after : ndarray, shape of run, m, by which the nominal arm misses each, as read and mended
    whole : whether no pose fits as it is
    """

    by: int
    run: IntArray
    before: Array
    after: Array
    whole: bool


def shifted(model: Model, data: Measurements, near: float, share: float) -> Shifted | None:
    """The run of poses that a shift by one brings near, None where there is none.

    near : m, by which the nominal arm may miss a pose; share : the same, of the spread of the points
    """
    order = data.poses.order
    if order is None:
        return None
    back = np.argsort(order)
    data, order = data.take(back), order[back]
    found = None
    for by in (1, -1):
        rows, moved = _moved(data, order, by)
        for values in _placings(model, data, moved, near, share):
            own = _run(model, data, rows, moved, values, near)
            if own is not None and (found is None or len(own[0]) > len(found.run)):
                run, before, after, alone = own
                found = Shifted(by, back[run], before, after, alone)
    return found


def _moved(data: Measurements, order: Array, by: int) -> tuple[IntArray, Measurements]:
    """Rows that have a neighbour, and their readings at the joints of that neighbour."""
    rows = np.arange(len(data))
    beside = rows + by
    there = (beside >= 0) & (beside < len(data))
    there[there] = order[beside[there]] - order[rows[there]] == by  # none between was held out
    rows, beside = rows[there], beside[there]
    return rows, replace(data.take(rows), poses=data.poses.take(beside))


def _placings(
    model: Model, data: Measurements, moved: Measurements, near: float, share: float
) -> Iterator[Array]:
    """Base and markers from what fits of each half, as read and moved: a run leaves one half alone."""
    for own in (moved, data):
        middle = len(own) // 2
        for half in (slice(None, middle), slice(middle, None)):
            sample = some(own.take(half), _SHIFT_POSES)
            if telling(sample):
                fit = placed(model, sample)
                if fit.rms <= near and fit.share <= share and fit.kept.mean() >= _MOST:
                    yield fit.values


def _run(
    model: Model,
    data: Measurements,
    rows: IntArray,
    moved: Measurements,
    values: Array,
    near: float,
) -> tuple[IntArray, Array, Array, bool] | None:
    """The run of poses that fit only if moved, and by how much each is missed before and after."""
    before, after = missed_by(model, data, values), np.full(len(data), np.inf)
    after[rows] = missed_by(model, moved, values)
    as_read, as_moved = before <= near, after <= near
    only: Mask = as_moved & ~as_read
    if only.sum() < _FEWEST:
        return None
    first, last = np.flatnonzero(only)[[0, -1]]
    run = np.arange(first, last + 1)
    held = np.isfinite(after[run])
    outside = np.delete(as_read, run)
    outside_fits = float(outside.mean()) if len(outside) > 2 else 1.0
    if as_moved[run][held].mean() < _MOST or outside_fits < _MOST:
        return None
    run = run[held & as_moved[run]]
    return run, before[run], after[run], not (as_read & ~as_moved).any()


# -- markers under each other's names --------------------------------------------------------------


def exchanged(model: Model, data: Measurements) -> tuple[IntArray, Array, Array]:
    """The exchange of two markers that fits each pose best: the marker that each one is, (m, M).

    Beside it by how much the nominal arm misses each pose as read, and with its exchange, (m,), m; zero
    where nothing can be told. Where half of the readings or more are exchanged, the others come out.
    """
    m, M = data.seen.shape
    order = np.tile(np.arange(M), (m, 1))
    before, after = np.zeros(m), np.zeros(m)
    for station in range(len(data.poses.stations)):
        here = np.flatnonzero((data.poses.station == station) & (data.seen.sum(axis=1) >= 2))
        own = data.take(here)
        values = _settled(model, own)
        if values is None:
            continue
        order[here] = _best_order(model, own, values)
        before[here] = missed_by(model, own, values)
        after[here] = missed_by(model, reordered(own, order[here]), values)
    return order, before, after


def _settled(model: Model, data: Measurements) -> Array | None:
    """Base and markers once the exchanges are undone: fit and exchange take turns on some poses."""
    sample = some(data, _EXCHANGE_POSES)
    if not telling(sample):
        return None
    values, last = placed(model, sample).values, np.zeros(0, dtype=int)
    for _ in range(_TURNS):
        order = _best_order(model, sample, values)
        if np.array_equal(order, last):
            break
        values, last = placed(model, reordered(sample, order)).values, order
    return values


def reordered(data: Measurements, order: IntArray) -> Measurements:
    """The readings with the markers of each pose in another order, (m, M), or (M,) of all poses."""
    order = np.broadcast_to(order, data.seen.shape)
    return replace(
        data,
        readings=np.take_along_axis(data.points, order[..., None], axis=1),
        seen=np.take_along_axis(data.seen, order, axis=1),
        sigma=np.take_along_axis(data.sigma, order, axis=1),
    )


def _best_order(model: Model, data: Measurements, values: Array) -> IntArray:
    """The exchange of one pair that brings each pose nearest to its prediction, shape (m, M)."""
    expected = model.predict(values, data.poses)
    m, M = data.seen.shape
    apart = ((data.points[:, :, None] - expected[:, None]) ** 2).sum(axis=-1)
    pairs = np.array(list(itertools.combinations(range(M), 2)))
    a, b = pairs.T
    gain = apart[:, a, a] + apart[:, b, b] - apart[:, a, b] - apart[:, b, a]
    gain = np.where(data.seen[:, a] & data.seen[:, b], gain, 0.0)
    best, rows = gain.argmax(axis=1), np.arange(m)
    better = gain[rows, best] > 0.0
    order = np.tile(np.arange(M), (m, 1))
    rows, a, b = rows[better], a[best[better]], b[best[better]]
    order[rows, a], order[rows, b] = b, a
    return order
