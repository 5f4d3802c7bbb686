"""The poses that make the worst of several rivalries as clear as can be: greedy, then exchange."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, Mask
from doe.prospect.rivals.evidence import Evidence, Known
from doe.prospect.situation import Offer

_PASSES = 3  # over all places of the plan, while exchanges still help
_BETTER = 1e-6
_OTHERS = 1e-3  # weight of the mean beside the worst pair: it decides between equals
_CLEAR = 4.0  # standard deviations beyond which a pair gains nothing any more


@dataclass(frozen=True, eq=False)
class Contested:
    """Rivals of one place, as the search sees them.

    rows : int, N of the data and of the poses to be chosen
    hopeful : ndarray of bool, shape (pairs,), pairs that candidates can tell apart
    """

    evidence: Evidence
    rows: int
    hopeful: Mask

    def margins(self, known: Known, S: Array | None = None) -> Array:
        """Of the hopeful pairs, shape (..., hopeful); S : other Gram matrices than those known."""
        return self.evidence.margins(known, S, self.rows)[..., self.hopeful]


def contested(
    evidence: Evidence, offer: Offer, start: Array, count: int, clear: float
) -> Contested:
    """Which pairs some choice of candidates might tell apart.

    start : ndarray, shape (dof,), where the arm stands; count : int, poses to be chosen
    clear : float, margin at which a pair counts as told apart; a pair that no choice brings there is
        not worth the poses that others need
    """
    blocks = evidence.blocks(offer.rows(slice(None), start))
    rows = evidence.data.rows + count * blocks.shape[1]
    reach = evidence.reach(blocks, min(count, len(blocks)), rows)
    return Contested(evidence, rows, reach >= clear)


@dataclass(frozen=True, eq=False)
class Search:
    """Rivalries, each with a pair that candidates can tell apart, and the candidates.

    start : ndarray, shape (dof,), where the arm stands
    """

    places: tuple[Contested, ...]
    offer: Offer
    start: Array

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
        """Score of a sequence: the worst pair's margin, and a little of the mean."""
        each = zip(self.places, self.known(plan), strict=True)
        return float(_score([place.margins(known) for place, known in each]))

    def known(self, plan: Sequence[int]) -> list[Known]:
        """What is known of every place after the data and a sequence of candidates."""
        found, before = [place.evidence.data for place in self.places], self.start
        for index in plan:
            found = self._added(found, index, before)
            before = self.offer.q[index]
        return found

    def _before(self, plan: Sequence[int]) -> Array:
        return np.asarray(self.offer.q[plan[-1]] if plan else self.start)

    def _added(self, known: list[Known], index: int, before: Array) -> list[Known]:
        rows = self.offer.rows(np.array([index]), before)[0]
        return [
            own.added(place.evidence.blocks(rows))
            for own, place in zip(known, self.places, strict=True)
        ]

    def _best(self, known: list[Known], before: Array, taken: list[int]) -> int:
        """The candidate that adds most when it follows ``before``."""
        rows = self.offer.rows(slice(None), before)
        scores = _score(
            [
                place.margins(own, own.tried(place.evidence.blocks(rows)))
                for own, place in zip(known, self.places, strict=True)
            ]
        )
        scores[taken] = -np.inf
        return int(scores.argmax())


def _score(margins: list[Array]) -> Array:
    """The worst pair's margin, and a little of the mean; from those of each place, (..., pairs)."""
    together = np.minimum(np.concatenate(margins, axis=-1), _CLEAR)
    return np.asarray(together.min(axis=-1) + _OTHERS * together.mean(axis=-1))


def search_of(
    rivals: Sequence[Evidence], offer: Offer, start: Array, count: int, clear: float
) -> Search | None:
    """The search over all places where something can be told apart; None where nothing can.

    start : ndarray, shape (dof,), where the arm stands
    """
    places = [contested(evidence, offer, start, count, clear) for evidence in rivals]
    hopeful = tuple(place for place in places if place.hopeful.any())
    return Search(hopeful, offer, start) if hopeful else None
