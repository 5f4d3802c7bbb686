"""The poses that make the worst of what is asked as clear as can be: greedy, then exchange."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from calib.arrays import Array
from doe.ahead.evidence import ReducedEquations, RivalEvidence
from doe.ahead.situation import CandidateRows

_PASSES = 3  # over all places of the plan, while exchanges still help
_BETTER = 1e-6
_OTHERS = 1e-3  # weight of the mean beside the worst pair: it decides between equals
_CLEAR = 4.0  # standard deviations beyond which a pair gains nothing any more


class Objective(Protocol):
    """What poses are asked for, as the search sees it: the larger its values, the better."""

    @property
    def data(self) -> ReducedEquations:
        """What is known after the data."""

    def blocks(self, rows: Array, q: Array) -> Array:
        """Rows (m, r, p) of configurations (m, dof) in the coordinates of the equations."""

    def values(self, known: ReducedEquations, S: Array) -> Array:
        """Of what is known, for Gram matrices S (..., K, K), its own or tried ones, shape (..., k)."""


def worst(values: Sequence[Array]) -> Array:
    """The worst of all, and a little of the mean; from those of each objective, (..., k)."""
    together = np.minimum(np.concatenate(values, axis=-1), _CLEAR)
    return np.asarray(together.min(axis=-1) + _OTHERS * together.mean(axis=-1))


@dataclass(frozen=True, eq=False)
class PoseSearch:
    """Chooses candidate poses for one or several objectives, greedily and then by exchange.

    start : ndarray, shape (dof,), where the arm stands
    weigh : what is made as large as can be, from the values of every objective
    """

    objectives: tuple[Objective, ...]
    offer: CandidateRows
    start: Array
    weigh: Callable[[Sequence[Array]], Array] = worst

    def best_plan(self, count: int) -> list[int]:
        """A sequence of candidates that no exchange of one of them improves."""
        return self.exchanged(self.greedy(count))

    def greedy(self, count: int) -> list[int]:
        """Candidate by candidate, each the best after those before."""
        plan: list[int] = []
        known = self.known(plan)
        for _ in range(min(count, len(self.offer))):
            before = self._before(plan)
            index = self._best(known, before, plan)
            known = self._added(known, index, before)
            plan = [*plan, index]
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

    def known(self, plan: Sequence[int]) -> list[ReducedEquations]:
        """What is known for every objective after the data and a sequence of candidates."""
        found = [objective.data for objective in self.objectives]
        for k, index in enumerate(plan):
            found = self._added(found, index, self._before(plan[:k]))
        return found

    def _before(self, plan: Sequence[int]) -> Array:
        return np.asarray(self.offer.q[plan[-1]] if plan else self.start)

    def _added(
        self, known: list[ReducedEquations], index: int, before: Array
    ) -> list[ReducedEquations]:
        one = np.array([index])
        rows, q = self.offer.rows(one, before), self.offer.q[one]
        each = zip(known, self.objectives, strict=True)
        return [own.added(objective.blocks(rows, q)) for own, objective in each]

    def _best(self, known: list[ReducedEquations], before: Array, taken: list[int]) -> int:
        """The candidate that adds most when it follows ``before``."""
        rows, q = self.offer.rows(slice(None), before), self.offer.q
        each = zip(known, self.objectives, strict=True)
        tried = [
            objective.values(own, own.tried(objective.blocks(rows, q))) for own, objective in each
        ]
        scores = self.weigh(tried)
        scores[taken] = -np.inf
        return int(scores.argmax())


def search_of(
    rivals: Sequence[RivalEvidence],
    offer: CandidateRows,
    start: Array,
    count: int,
    others: Sequence[Objective] = (),
) -> PoseSearch | None:
    """The search over all rivals that can be told apart, and other objectives; None where none is left.

    start : ndarray, shape (dof,), where the arm stands
    """
    reached = [evidence.within_reach(offer, start, count) for evidence in rivals]
    found = (*(own for own in reached if own.pairs), *others)
    return PoseSearch(found, offer, start) if found else None
