"""From weights to the best whole plan found: many starts on a short list, then the whole pool."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, IntArray
from doe.optimal.allowed import Allowed
from doe.optimal.blocks import Blocks
from doe.optimal.certify import survivors
from doe.optimal.exchange import exchange, greedy, rounded_weights
from doe.optimal.function import InformationFunction
from doe.optimal.relax import Relaxation

_STARTS, _FEWEST_STARTS = 12, 3
_KICKS, _FEWEST_KICKS = 30, 6
_SMALL = 12  # parameters up to which starts and kicks are not cut: their cost grows with p^3
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
    """Search from many starts, then over every candidate that a better plan may contain.

    thorough : else from the rounded weights and the greedy plan alone, a few per mille lower
    """
    rng = np.random.default_rng(seed)
    listed = _short_list(blocks, allowed, relaxed)
    part, rules = blocks.take(listed), allowed.take(listed)
    weights = np.zeros(len(listed))
    weights[np.searchsorted(listed, relaxed.index)] = relaxed.weights
    everyone = np.arange(len(listed))
    first = [rounded_weights(rules, everyone, weights, None), greedy(criterion, part, rules)]
    effort = min(1.0, (_SMALL / len(blocks.fixed)) ** 1.5)
    count = max(_FEWEST_STARTS, round(_STARTS * effort)) * thorough
    first += [rounded_weights(rules, everyone, weights, rng) for _ in range(count)]
    found = [exchange(criterion, part, rules, plan) for plan in first]
    plan, value = max(found, key=lambda pair: pair[1])
    starts = np.array([value for _, value in found])
    kicks = max(_FEWEST_KICKS, round(_KICKS * effort)) * thorough
    plan, value = _kicked(criterion, part, rules, plan, value, kicks, rng)
    plan = listed[plan]
    kept = np.union1d(survivors(relaxed.G, blocks, allowed, value), plan)
    part, rules = blocks.take(kept), allowed.take(kept)
    plan, value = exchange(criterion, part, rules, np.searchsorted(kept, plan))
    return Found(kept[plan], value, starts)


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


def _kicked(
    criterion: InformationFunction,
    blocks: Blocks,
    allowed: Allowed,
    plan: IntArray,
    value: float,
    kicks: int,
    rng: np.random.Generator,
) -> tuple[IntArray, float]:
    """Iterated local search: replace a few poses by chance, improve, keep what is better."""
    for _ in range(kicks):
        trial = plan.copy()
        for slot in rng.choice(len(plan), min(3, len(plan)), replace=False):
            members = allowed.members[allowed.group[plan[slot]]]
            free = members if allowed.repeats else np.setdiff1d(members, trial)
            if len(free):
                trial[slot] = rng.choice(free)
        trial, found = exchange(criterion, blocks, allowed, trial, levels_too=False)
        if found > value:
            plan, value = trial, found
    return plan, value
