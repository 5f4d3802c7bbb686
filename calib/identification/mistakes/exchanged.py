"""Markers that changed their names in some of the readings."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np

from calib.arrays import Array, IntArray
from calib.identification.mistakes.placed import missed_by, placed, some, telling
from calib.model import Model
from calib.poses import Measurements

_POSES = 60
_ROUNDS = 12


@dataclass(frozen=True, eq=False)
class Exchanged:
    """The exchange of two markers that fits each pose best.

    order : ndarray of int, shape (m, M), the marker that each one is
    before, after : ndarray, shape (m,), m, by which the nominal arm misses each pose, as read and with
        its exchange; zero where nothing can be told
    """

    order: IntArray
    before: Array
    after: Array


def exchanged(model: Model, data: Measurements) -> Exchanged:
    """What each pose gains by an exchange of two markers.

    Where half of the readings or more are exchanged, the others come out.
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
    return Exchanged(order, before, after)


def _settled(model: Model, data: Measurements) -> Array | None:
    """Base and markers once the exchanges are undone: fit and exchange take turns on some poses."""
    sample = some(data, _POSES)
    if not telling(sample):
        return None
    values, last = placed(model, sample).values, np.zeros(0, dtype=int)
    for _ in range(_ROUNDS):
        order = _best_order(model, sample, values)
        if np.array_equal(order, last):
            break
        values, last = placed(model, reordered(sample, order)).values, order
    return values


def reordered(data: Measurements, order: IntArray) -> Measurements:
    """The readings with the markers of each pose in another order, (m, M)."""
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
