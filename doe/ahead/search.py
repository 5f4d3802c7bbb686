"""The poses that make the worst of what is asked as clear as can be: greedy, then exchange.

Of causes and of the error at the targets, what a plan reaches counts as a share of what as many poses
for it alone would reach, from what the data know already. Shares have no unit and can be added: a
compound criterion, as that of McGree, Eccleston and Duffull (J. Biopharm. Stat. 18(2), 2008) for D and
T.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from calib.arrays import Array
from doe.ahead.forecast import Offer
from doe.ahead.information import Information

_DRAWN = 4  # sequences by chance that are improved beside the greedy one, of so few poses
_FEW = 12
_PASSES = 3  # over all places of the plan, while exchanges still help
_BETTER = 1e-6
_OTHERS = 1e-3  # weight of the mean beside the worst pair: it decides between equals
_CLEAR = 4.0  # standard deviations beyond which a pair gains nothing any more


class Objective(Protocol):
    """A question as the search sees it: the larger its values, the better."""

    @property
    def now(self) -> Information:
        """What is known after the data."""

    def columns_of(self, rows: Array, q: Array) -> Array:
        """Rows (m, r, p) of configurations (m, dof) in the columns of the information."""

    def values(self, known: Information, S: Array) -> Array:
        """Of what is known, for Schur complements S (..., K, K), its own or tried ones, (..., k)."""


def worst(values: Sequence[Array]) -> Array:
    """The worst of all, and a little of the mean; from those of each objective, (..., k)."""
    together = np.minimum(np.concatenate(values, axis=-1), _CLEAR)
    return np.asarray(together.min(axis=-1) + _OTHERS * together.mean(axis=-1))


def last(values: Sequence[Array]) -> Array:
    """The last objective alone, of one value."""
    return values[-1][..., 0]


@dataclass(frozen=True, eq=False)
class PoseSearch:
    """Chooses candidate poses for one or several objectives, greedily and then by exchange.

    start : ndarray, shape (dof,), where the arm stands
    weigh : what is made as large as can be, from the values of every objective
    """

    objectives: tuple[Objective, ...]
    offer: Offer
    start: Array
    weigh: Callable[[Sequence[Array]], Array] = worst

    def best_plan(self, count: int) -> list[int]:
        """The best of some sequences that no exchange of one candidate improves."""
        rng, n = np.random.default_rng(0), len(self.offer)
        more = _DRAWN if count <= _FEW else 0
        drawn = [rng.permutation(n)[:count].tolist() for _ in range(more)]
        return max(map(self.exchanged, [self.greedy(count), *drawn]), key=self.value)

    def greedy(self, count: int) -> list[int]:
        """Candidate by candidate, each the best after those before."""
        plan: list[int] = []
        for _ in range(min(count, len(self.offer))):
            plan = [*plan, self._best(self.known(plan), self._before(plan), plan)]
        return plan

    def exchanged(self, plan: list[int]) -> list[int]:
        """Replace one pose at a time, while that helps (Fedorov's exchange)."""
        value = self.value(plan)
        for _ in range(_PASSES):
            changed = False
            for place in range(len(plan)):
                rest = [*plan[:place], *plan[place + 1 :]]
                other = self._best(self.known(rest), self._before(plan[:place]), rest)
                trial = [*plan[:place], other, *plan[place + 1 :]]
                # What follows is now reached from elsewhere: the whole sequence decides.
                if other != plan[place] and (better := self.value(trial)) > value + _BETTER:
                    plan, value, changed = trial, better, True
            if not changed:
                break
        return plan

    def value(self, plan: Sequence[int]) -> float:
        """What a sequence is worth."""
        return float(self.weigh(self.values(plan)))

    def values(self, plan: Sequence[int]) -> list[Array]:
        """Of every objective, after the data and a sequence of candidates."""
        each = zip(self.objectives, self.known(plan), strict=True)
        return [objective.values(known, known.S) for objective, known in each]

    def known(self, plan: Sequence[int]) -> list[Information]:
        """What is known for every objective after the data and a sequence of candidates."""
        if not len(plan):
            return [objective.now for objective in self.objectives]
        each = (
            self.offer.rows(np.array([index]), self._before(plan[:k]))
            for k, index in enumerate(plan)
        )
        rows, q = np.concatenate(list(each)), self.offer.q[list(plan)]
        return [own.now.added(own.columns_of(rows, q)) for own in self.objectives]

    def _before(self, plan: Sequence[int]) -> Array:
        return np.asarray(self.offer.q[plan[-1]] if len(plan) else self.start)

    def _best(self, known: list[Information], before: Array, taken: list[int]) -> int:
        """The candidate that adds most when it follows ``before``."""
        rows, q = self.offer.condensed.rows(slice(None), before), self.offer.q
        each = zip(known, self.objectives, strict=True)
        tried = [
            objective.values(own, own.tried(objective.columns_of(rows, q)))
            for own, objective in each
        ]
        scores = self.weigh(tried)
        scores[taken] = -np.inf
        return int(scores.argmax())


@dataclass(frozen=True, eq=False)
class CompoundCriterion:
    """The mean efficiency for telling causes apart, and for accuracy, which is the last objective.

    Each is the share of what poses for it alone would reach.
    now, best : values of the two, with the data and at best
    """

    now: tuple[float, float]
    best: tuple[float, float]

    def of(self, values: Sequence[Array]) -> tuple[Array, Array]:
        """Both shares of the values of all objectives (..., k), shape (...)."""
        reached = worst(values[:-1]), last(values)
        first, second = (
            (own - now) / max(best - now, 1e-9)
            for own, now, best in zip(reached, self.now, self.best, strict=True)
        )
        return np.asarray(first), np.asarray(second)

    def __call__(self, values: Sequence[Array]) -> Array:
        """The mean of both."""
        first, second = self.of(values)
        return np.asarray(0.5 * (first + second))


def with_accuracy(search: PoseSearch, accuracy: Objective, count: int) -> PoseSearch:
    """The search for causes and accuracy together."""
    alone = replace(search, objectives=(accuracy,), weigh=last)
    both = replace(search, objectives=(*search.objectives, accuracy))
    ends = search.value(search.best_plan(count)), alone.value(alone.best_plan(count))
    return replace(both, weigh=CompoundCriterion((search.value(()), alone.value(())), ends))
