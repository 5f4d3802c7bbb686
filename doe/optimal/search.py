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
_GAIN = 1e-6  # relative, that counts as one
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
    weights = np.zeros(len(listed))
    weights[np.searchsorted(listed, relaxed.index)] = relaxed.weights
    breadth = breadth_of(rules, len(blocks.fixed))
    count, even = (breadth.starts, breadth.even) if thorough else (_QUICK, 0)
    everyone, same = np.arange(len(listed)), np.ones(len(listed))
    drawn = [
        rounded_weights(rules, everyone, same if k < even else weights, rng)
        for k in range(count - 1)
    ]
    first = np.array([rounded_weights(rules, everyone, weights, None), *drawn])
    plans, starts = _started(criterion, part, rules, first, breadth)
    values = starts
    if thorough:
        plans, values = _bred(criterion, part, rules, plans, values, breadth, rng)
    plan, value = listed[plans[values.argmax()]], float(values.max())
    kept = np.union1d(survivors(relaxed.G, blocks, allowed, value), plan)
    part, rules = blocks.take(kept), allowed.take(kept)
    plan, value = exchange(criterion, part, rules, np.searchsorted(kept, plan))
    plan = kept[plan]
    if thorough and provable(criterion, allowed):
        proof = prove(criterion, blocks, allowed, plan, relaxed.G)
        plan, value = proof.plan, proof.value
    return Found(plan, value, starts)


def _short_list(
    blocks: Blocks,
    allowed: Allowed,
    relaxed: Relaxation,
) -> IntArray:
    """Candidates with weight, and those that the relaxation prices next."""
    scores = blocks.scores(relaxed.G)
    tops = []
    for members, count in zip(allowed.members, allowed.counts, strict=True):
        k = min(max(int(count) + 5, _SHORT // len(allowed.positions)), len(members))
        tops.append(members[np.argsort(-scores[members], kind="stable")[:k]])
    return np.unique(np.concatenate([relaxed.index, *tops]))


def _started(
    criterion: InformationFunction,
    blocks: Blocks,
    allowed: Allowed,
    plans: IntArray,
    breadth: Breadth,
) -> tuple[IntArray, Array]:
    if allowed.chooses_levels:
        found = [exchange(criterion, blocks, allowed, plan) for plan in plans]
        return np.array([plan for plan, _ in found]), np.array([value for _, value in found])
    return _settled(criterion, blocks, allowed, plans, breadth, breadth.eased, breadth.whole)


def _settled(
    criterion: InformationFunction,
    blocks: Blocks,
    allowed: Allowed,
    plans: IntArray,
    breadth: Breadth,
    eased: tuple[float, ...],
    whole: int,
) -> tuple[IntArray, Array]:
    """Local optima; those of few poses by way of problems in which average poses help, less and less.

    whole : int, plans that go on without help, those that are best where it is least
    """
    if not eased:
        return improved(criterion, blocks, allowed, plans)
    for share in eased:
        helped = blocks.beside(share * allowed.size * blocks.mean)
        plans, values = improved(criterion, helped, allowed, plans)
    best = plans[np.argsort(-values)[:whole]]
    return improved(criterion, blocks, allowed, best, closely=breadth.closely)


def _bred(
    criterion: InformationFunction,
    blocks: Blocks,
    allowed: Allowed,
    plans: IntArray,
    values: Array,
    breadth: Breadth,
    rng: np.random.Generator,
) -> tuple[IntArray, Array]:
    """Plans kicked and crossed, improved, the best kept, until there is no gain for a while."""
    crossable = not (allowed.repeats or allowed.chooses_levels)
    idle = 0
    for _ in range(_ROUNDS):
        # One of those that ended alike: plans that differ.
        _, kept = np.unique(np.round(np.log(values) / _GAIN), return_index=True)
        kept = kept[::-1][: breadth.best]
        plans, values = plans[kept], values[kept]
        children = [kicked(allowed, plan, rng) for plan in plans for _ in range(breadth.kicks)]
        if crossable and len(plans) > 1:
            pairs = [rng.choice(len(plans), 2, replace=False) for _ in plans]
            children += [
                kicked(allowed, crossed(allowed, plans[a], plans[b], rng), rng) for a, b in pairs
            ]
        else:
            children += [kicked(allowed, plan, rng) for plan in plans]
        few, last = breadth.whole // 3, breadth.eased[-1:]
        new, found = _settled(criterion, blocks, allowed, np.array(children), breadth, last, few)
        idle = 0 if found.max() > values.max() * (1.0 + _GAIN) else idle + 1
        plans, values = np.concatenate([plans, new]), np.concatenate([values, found])
        if idle >= _PATIENCE:
            break
    return plans, values
