"""Points that stand one pose beside the joints that they belong to, in all of a table or a part."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from calib.arrays import Array, IntArray, Mask
from calib.identification.mistakes.placed import missed_by, placed, some, telling
from calib.model import Model
from calib.poses import Measurements

_POSES = 40
_FEWEST = 5  # poses that only the shift explains: a few wrong readings are no shift
_MOST = 0.9  # of the poses must fit, as they are or shifted, and of the run with the shift


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
            sample = some(own.take(half), _POSES)
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
