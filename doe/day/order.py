"""The order in which poses are visited in least time.

An open way through n places is a round trip through these and one more that is no time from any: the
symmetric travelling salesman.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from calib.arrays import Array, IntArray

_KICKS = 60
_SEGMENT = 3  # places that move together
_LEAST = 1e-9  # of the mean cost: an improvement


def shortest_order(cost: Array, seed: int = 0) -> IntArray:
    """Order of n places with a small sum of costs (n, n) from each to the next; it ends anywhere.

    Stretches are reversed (Croes, Operations Research 6(6), 1958) and up to three places moved (Or,
    1976) while that helps; then the best trip is cut in three, joined otherwise, and improved again
    (iterated local search; Johnson, McGeoch 1997).
    """
    if len(cost) < 3:
        return np.arange(len(cost))
    padded, rng = np.pad(cost, (0, 1)), np.random.default_rng(seed)
    best = _improved(_nearest(padded), padded)
    length = _length(best, padded)
    for _ in range(_KICKS if len(best) > 4 else 0):
        cuts = np.sort(rng.choice(np.arange(1, len(best)), 3, replace=False))
        a, b, c, d = np.split(best, cuts)
        tried = _improved(np.concatenate([a, c, b, d]), padded)
        if (found := _length(tried, padded)) < length:
            best, length = tried, found
    way = np.roll(best, -int(np.flatnonzero(best == len(cost))[0]))[1:]
    # Of a way and its reverse, which are equally long, the one that begins with the earlier place.
    return np.asarray(way if way[0] < way[-1] else way[::-1])


def _length(trip: IntArray, cost: Array) -> float:
    return float(cost[trip, np.roll(trip, -1)].sum())


def _nearest(cost: Array) -> IntArray:
    """A trip from the last place, that of no time, to the nearest one that is left, and so on."""
    trip, left = [len(cost) - 1], np.ones(len(cost), dtype=bool)
    left[-1] = False
    while left.any():
        nearest = int(np.where(left, cost[trip[-1]], np.inf).argmin())
        trip.append(nearest)
        left[nearest] = False
    return np.array(trip)


def _improved(trip: IntArray, cost: Array) -> IntArray:
    """The trip after the best changes, one after another, until none helps."""
    least = -_LEAST * float(cost.mean())
    while True:
        gain, changed = min(_changes(trip, cost), key=lambda change: change[0])
        if gain >= least:
            return trip
        trip = changed


def _changes(trip: IntArray, cost: Array) -> Iterator[tuple[float, IntArray]]:
    """What the best change of each kind adds, and the trip after it."""
    m, after = len(trip), np.roll(trip, -1)
    step = cost[trip, after]
    turned = cost[trip[:, None], trip] + cost[after[:, None], after] - step[:, None] - step
    turned[np.tril_indices(m)] = np.inf
    i, j = np.unravel_index(int(turned.argmin()), turned.shape)
    yield (
        float(turned[i, j]),
        np.concatenate([trip[: i + 1], trip[i + 1 : j + 1][::-1], trip[j + 1 :]]),
    )
    row, column = np.ogrid[:m, :m]
    for size in range(1, min(_SEGMENT, m - 3) + 1):
        last, before = np.roll(trip, 1 - size), np.roll(trip, 1)
        out = (
            cost[before, np.roll(trip, -size)]
            - cost[before, trip]
            - cost[last, np.roll(trip, -size)]
        )
        own = (column - row + 1) % m <= size
        for first, end in ((trip, last), (last, trip)):
            into = cost[trip, first[:, None]] + cost[end[:, None], after] - step
            added = np.where(own, np.inf, out[:, None] + into)
            i, j = np.unravel_index(int(added.argmin()), added.shape)
            rolled, at = np.roll(trip, -i), (j - i) % m + 1 - size
            part = rolled[:size] if first is trip else rolled[:size][::-1]
            rest = rolled[size:]
            yield float(added[i, j]), np.concatenate([rest[:at], part, rest[at:]])
