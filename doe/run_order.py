"""The order of a plan whose model depends on the time: what it tells, then how long it takes.

Poses that are read early tell other things of a drift than late ones. Of all orders that tell nearly as
much as the best one found, the one with the shortest ways is taken. Orders are improved by exchanging
two poses, turning a stretch round, and moving one pose (Joiner, Campbell, Technometrics 18(3), 1976,
weigh cost against a trend in time in the same way).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from calib.arrays import Array, IntArray
from doe.day.day import travel_times
from doe.day.order import shortest_order
from doe.optimal.blocks import pack, unpack
from doe.problem import Problem
from doe.problem.visits import Visits

_NEARLY = 0.98  # of the best criterion that an order reaches: what shorter ways may cost
_EXACT = 40  # orders of a round that are judged exactly
_MOST = 4000  # orders of a round
_ROUNDS = 300
_WORTH = 1e-9


def in_run_order(problem: Problem, visits: Visits) -> Visits:
    """The visits of a plan in their order, each at the time when it is reached."""
    choice, cell = problem.choice, problem.cell
    rank = np.repeat(np.arange(len(choice.times)), choice.counts(len(visits)))
    seconds = travel_times(cell, visits.q, visits.move)
    runs = _Runs(problem, _told_at_each(problem, visits), seconds, rank)
    best = runs.telling_most(np.argsort(visits.moment, kind="stable"))  # type: ignore[arg-type]
    least = _NEARLY * runs.value(best)
    quick = runs.telling_enough(shortest_order(seconds), least)
    starts = [best] if runs.value(quick) < least else [best, quick]
    order = min((runs.shortened(start, least) for start in starts), key=runs.travel)
    between = np.append(0.0, seconds[order[:-1], order[1:]])
    time = np.cumsum(between + cell.pace.standing(cell.load is not None))
    return replace(visits.take(order), moment=rank, time=choice.begin + time - time[0])


def _told_at_each(problem: Problem, visits: Visits) -> Array:
    """Information of each of N visits at each of S moments, packed, shape (N, S, k)."""
    found = []
    for k, time in enumerate(problem.choice.times):
        at = replace(visits, moment=np.full(len(visits), k), time=np.full(len(visits), time))
        found.append(pack(problem.information(at)))
    return np.stack(found, axis=1)


@dataclass(frozen=True, eq=False)
class _Runs:
    """Orders of N visits, arrays of int of shape (N,), by what they tell and how long their ways are.

    told : ndarray, shape (N, S, k), packed information at each moment; seconds : ndarray, shape (N, N),
        between visits; rank : ndarray of int, shape (N,), moment of each place in the order
    """

    problem: Problem
    told: Array
    seconds: Array
    rank: IntArray

    def value(self, order: IntArray) -> float:
        return float(self._values(order[None])[0])

    def travel(self, order: IntArray) -> float:
        return float(self._travels(order[None])[0])

    def _values(self, orders: IntArray) -> Array:
        M = self.problem.fixed + unpack(self.told[orders, self.rank].sum(axis=1))
        return np.asarray(self.problem.criterion.plain.value(M))

    def _travels(self, orders: IntArray) -> Array:
        return np.asarray(self.seconds[orders[:, :-1], orders[:, 1:]].sum(axis=1))

    def _promised(self, order: IntArray, orders: IntArray) -> Array:
        """What the criterion of other orders is at most: it is concave."""
        M = self.problem.fixed + unpack(self.told[order, self.rank].sum(axis=0))
        scores = self.told @ pack(self.problem.criterion.plain.gradient(M))
        gain = scores[orders, self.rank].sum(axis=1) - scores[order, self.rank].sum()
        return np.asarray(self.value(order) + gain)

    def telling_most(self, order: IntArray) -> IntArray:
        """The order after the best changes, one after another, until none tells more."""
        for _ in range(_ROUNDS):
            orders = _changed(order)
            tried = orders[np.argsort(-self._promised(order, orders))[:_EXACT]]
            values = self._values(tried)
            if values.max(initial=0.0) <= self.value(order) * (1.0 + _WORTH):
                break
            order = tried[values.argmax()]
        return order

    def telling_enough(self, order: IntArray, least: float) -> IntArray:
        """The order after changes that tell much for the way that they cost, until it tells enough."""
        for _ in range(_ROUNDS):
            now, way = self.value(order), self.travel(order)
            if now >= least:
                break
            orders = _changed(order)
            cost = np.maximum(self._travels(orders) - way, 1e-3 * way)
            tried = np.argsort(-(self._promised(order, orders) - now) / cost)[:_EXACT]
            gains = (self._values(orders[tried]) - now) / cost[tried]
            if gains.max() <= 0.0:
                break
            order = orders[tried[gains.argmax()]]
        return order

    def shortened(self, order: IntArray, least: float) -> IntArray:
        """The order after the changes that shorten the ways most while it still tells enough."""
        for _ in range(_ROUNDS):
            orders = _changed(order)
            travels = self._travels(orders)
            may = (travels < self.travel(order) * (1.0 - _WORTH)) & (
                self._promised(order, orders) >= least
            )
            tried = np.flatnonzero(may)[np.argsort(travels[may])[:_EXACT]]
            enough = tried[self._values(orders[tried]) >= least] if len(tried) else tried
            if not len(enough):
                break
            order = orders[enough[0]]
        return order


def _changed(order: IntArray) -> IntArray:
    """Orders one change away from an order, shape (n, N), some of them where there are too many."""
    found = list(_changes(len(order)))
    if len(found) > _MOST:
        kept = np.random.default_rng(0).choice(len(found), _MOST, replace=False)
        found = [found[i] for i in kept]
    changed: IntArray = order[np.array(found, dtype=int).reshape(-1, len(order))]
    return changed


def _changes(count: int) -> Iterator[IntArray]:
    """Exchanges of two places, stretches turned round, and places that move."""
    places = np.arange(count)
    for i, j in combinations(range(count), 2):
        exchanged, turned = places.copy(), places.copy()
        exchanged[[i, j]] = j, i
        turned[i : j + 1] = places[i : j + 1][::-1]
        yield from (exchanged, turned, np.insert(np.delete(places, i), j, i))
        yield np.insert(np.delete(places, j), i, j)
