"""From weights to the best whole plan found: many starts, the whole pool, branch and bound."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, IntArray
from doe.optimal.allowed import Allowed
from doe.optimal.blocks import Blocks
from doe.optimal.branch import provable, prove
from doe.optimal.breadth import Breadth, breadth_of
from doe.optimal.certify import survivors
from doe.optimal.exchange import exchange, rounded_weights
from doe.optimal.function import InformationFunction
from doe.optimal.lockstep import crossed, improved, kicked
from doe.optimal.relax import Relaxation

_QUICK = 3  # starts where a search is not thorough
_ROUNDS = 40  # of breeding, at most
_PATIENCE = 3  # rounds without a gain after which there are no more
_SAME = 1e-6  # relative difference of criteria of one and the same plan
_WORTH = 2e-4  # relative gain of a round that is one
_SHORT = 1500  # candidates of the short list


@dataclass(frozen=True, eq=False)
class Found:
    """The best plan found.

    plan : ndarray of int, candidates; value : float, its criterion
    starts : ndarray, criterion at the local optimum that each start ended in: where they agree, what is
        missing to the bound is likely the bound's slack
    """

    plan: IntArray
    value: float
    starts: Array


def best_plan(
    criterion: InformationFunction,
    blocks: Blocks,
    allowed: Allowed,
    relaxed: Relaxation,
    *,
    seed: int,
    thorough: bool = True,
) -> Found:
    """Search from many starts, then among all that a better plan may contain, then by its bounds.

    thorough : else from a few rounded weights alone, some per mille lower
    """
    rng = np.random.default_rng(seed)
    listed = _short_list(blocks, allowed, relaxed)
    part, rules = blocks.take(listed), allowed.take(listed)
    search = _Search(criterion, part, rules, breadth_of(rules, len(blocks.fixed)))
    weights = np.zeros(len(listed))
    weights[np.searchsorted(listed, relaxed.index)] = relaxed.weights
    plans, starts = search.started(search.drawn(weights, thorough, rng))
    values = starts
    if thorough:
        plans, values = search.bred(plans, values, rng)
    plan, value = listed[plans[values.argmax()]], float(values.max())
    kept = np.union1d(survivors(relaxed.G, blocks, allowed, value), plan)
    part, rules = blocks.take(kept), allowed.take(kept)
    plan, value = exchange(criterion, part, rules, np.searchsorted(kept, plan))
    plan = kept[plan]
    if thorough and provable(criterion, allowed):
        proof = prove(criterion, blocks, allowed, plan, relaxed.G)
        plan, value = proof.plan, proof.value
    return Found(plan, value, starts)


def _short_list(blocks: Blocks, allowed: Allowed, relaxed: Relaxation) -> IntArray:
    """Candidates with weight, and those that the relaxation prices next."""
    scores = blocks.scores(relaxed.G)
    tops = []
    for members, count in zip(allowed.members, allowed.counts, strict=True):
        k = min(max(int(count) + 5, _SHORT // len(allowed.positions)), len(members))
        tops.append(members[np.argsort(-scores[members], kind="stable")[:k]])
    return np.unique(np.concatenate([relaxed.index, *tops]))


@dataclass(frozen=True, eq=False)
class _Search:
    """Many plans of the short list, improved, kicked and crossed."""

    criterion: InformationFunction
    blocks: Blocks
    allowed: Allowed
    breadth: Breadth

    def drawn(self, weights: Array, thorough: bool, rng: np.random.Generator) -> IntArray:
        """Plans to start from: the largest weights, draws by them, and draws that do not heed them."""
        everyone, same = np.arange(len(weights)), np.ones(len(weights))
        count, even = (self.breadth.starts, self.breadth.even) if thorough else (_QUICK, 0)
        drawn = [
            rounded_weights(self.allowed, everyone, same if k < even else weights, rng)
            for k in range(count - 1)
        ]
        return np.array([rounded_weights(self.allowed, everyone, weights, None), *drawn])

    def started(self, plans: IntArray) -> tuple[IntArray, Array]:
        """Local optima from those plans."""
        if self.allowed.chooses_levels:
            found = [exchange(self.criterion, self.blocks, self.allowed, plan) for plan in plans]
            return np.array([plan for plan, _ in found]), np.array([value for _, value in found])
        return self._settled(plans, self.breadth.eased, self.breadth.whole)

    def _settled(
        self, plans: IntArray, eased: tuple[float, ...], whole: int
    ) -> tuple[IntArray, Array]:
        """Local optima; those of few poses by way of problems in which average poses help, ever less.

        whole : int, plans that go on without help, those that are best where it is least
        """
        if not eased:
            return improved(self.criterion, self.blocks, self.allowed, plans)
        for share in eased:
            helped = self.blocks.beside(share * self.allowed.size * self.blocks.mean)
            plans, values = improved(self.criterion, helped, self.allowed, plans)
        best, closely = plans[np.argsort(-values)[:whole]], self.breadth.closely
        return improved(self.criterion, self.blocks, self.allowed, best, closely=closely)

    def bred(
        self, plans: IntArray, values: Array, rng: np.random.Generator
    ) -> tuple[IntArray, Array]:
        """Plans kicked and crossed, improved, the best kept, until there is no gain for a while."""
        idle, last = 0, self.breadth.eased[-1:]
        for _ in range(_ROUNDS):
            # One of those that ended alike: plans that differ.
            _, kept = np.unique(np.round(np.log(values) / _SAME), return_index=True)
            kept = kept[::-1][: self.breadth.best]
            plans, values = plans[kept], values[kept]
            new, found = self._settled(self._children(plans, rng), last, self.breadth.whole // 3)
            idle = 0 if found.max() > values.max() * (1.0 + _WORTH) else idle + 1
            plans, values = np.concatenate([plans, new]), np.concatenate([values, found])
            if idle >= _PATIENCE:
                break
        return plans, values

    def _children(self, plans: IntArray, rng: np.random.Generator) -> IntArray:
        """Each plan kicked so many times, and one crossed of every two, or kicked once more."""
        allowed = self.allowed
        found = [kicked(allowed, plan, rng) for plan in plans for _ in range(self.breadth.kicks)]
        if allowed.repeats or allowed.chooses_levels or len(plans) < 2:
            more = iter(plans)
        else:
            pairs = [rng.choice(len(plans), 2, replace=False) for _ in plans]
            more = (crossed(allowed, plans[a], plans[b], rng) for a, b in pairs)
        return np.array([*found, *(kicked(allowed, plan, rng) for plan in more)])
