"""Whole plans improved by exchanging one pose for a better candidate.

The criterion is concave, so a supergradient at the plan bounds every exchange from above by one dot
product. What could pay is ranked by what it brings to the other poses, exactly for D and for the
criteria that are a trace, and the best of it is judged exactly.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib.arrays import Array, IntArray
from doe.optimal.allowed import Allowed
from doe.optimal.blocks import lessened
from doe.optimal.selection import Selection

CHEAP = 15_000
"""Poses of a plan times entries of a matrix up to which an exchange takes no time."""
_JUDGED, _DOUBTED = 3, 24  # judged exactly in place of a pose, where their rank is exact or not
_RANKED = 100  # candidates of the largest price, or a quarter of all, that are ranked where it does
_PROMISING = 200  # candidates of a level that is tried in place of another
_NEARLY = 0.9999  # of a pose is taken away: the rest alone may be singular
_WORTH = 1e-7  # relative gain below which an exchange is rounding


def exchange(posed: Selection, plan: IntArray) -> tuple[IntArray, float]:
    """Improve a plan until no single exchange does, nor one of a whole level where levels are chosen.

    plan : ndarray of int, shape (size,), candidates; left as it is
    Returns the plan and its criterion, never lower than before.
    """
    plan, value = _singles(posed, plan.copy())
    while posed.allowed.chooses_levels:
        moved = _move_level(posed, plan, value)
        if moved is None:
            break
        plan, value = _singles(posed, moved)
    return plan, value


def _singles(posed: Selection, plan: IntArray) -> tuple[IntArray, float]:
    """Single exchanges, one pose after the other, until none helps; changes the plan."""
    criterion, blocks = posed.criterion, posed.blocks
    M = blocks.total(plan)
    value, idle, slot = float(criterion.value(M)), 0, 0
    prices, cov = blocks.scores(criterion.gradient(M)), np.asarray(np.linalg.inv(M))
    while idle < len(plan):
        base = M - blocks.matrices(plan[slot : slot + 1])[0]
        likely = _likely(posed, plan, slot, prices, cov, value)
        reached = criterion.value(base + blocks.matrices(likely))
        idle += 1
        if len(likely) and reached.max() > value * (1.0 + _WORTH):
            plan[slot], value, idle = likely[reached.argmax()], float(reached.max()), 0
            M = blocks.total(plan)
            prices, cov = blocks.scores(criterion.gradient(M)), np.asarray(np.linalg.inv(M))
        slot = (slot + 1) % len(plan)
    return plan, value


def _likely(
    posed: Selection, plan: IntArray, slot: int, prices: Array, cov: Array, value: float
) -> IntArray:
    """Candidates in place of one pose that are worth an exact judgement.

    prices : ndarray, shape (n,), of each candidate by the gradient at the plan, which prices the plan
        at its value; cov : ndarray, shape (p, p), covariance with the pose
    """
    criterion, rows, allowed = posed.criterion, posed.blocks.rows, posed.allowed
    here = allowed.members[allowed.group[plan[slot]]]
    free = prices[here] > prices[plan[slot]] + value * _WORTH
    if not allowed.repeats:
        taken = np.zeros(len(allowed.group), dtype=bool)
        taken[plan] = True
        free &= ~taken[here]
    live: IntArray = here[free]
    judged = _JUDGED if criterion.smooth else _DOUBTED
    if len(live) <= judged:
        return live
    ranked = max(_RANKED, len(here) // 4)
    if len(plan) * cov.size > CHEAP and len(live) > ranked:
        live = live[np.argpartition(-prices[live], ranked)[:ranked]]
    rest = lessened(cov, rows[plan[slot]], _NEARLY)
    brought = criterion.brought(rest, rows[live])
    best: IntArray = live[np.argpartition(-brought, judged)[:judged]]
    return best


def greedy(posed: Selection) -> IntArray:
    """Fill a plan up, each time with the candidate that adds most.

    Levels that are to be chosen are settled first, by the plan that is best to first order.
    """
    criterion, blocks, allowed = posed.criterion, posed.blocks, posed.allowed
    counts, M, chosen = allowed.counts, blocks.fixed, list[int]()
    if allowed.chooses_levels:
        _, first = allowed.best(blocks.scores(criterion.gradient(blocks.fixed + blocks.mean)))
        counts = np.bincount(allowed.group[first], minlength=len(counts))
    while len(chosen) < counts.sum():
        taken = np.bincount(allowed.group[chosen], minlength=len(counts)) if chosen else 0 * counts
        free = (taken < counts)[allowed.group]
        if not allowed.repeats:
            free[chosen] = False
        candidates = np.flatnonzero(free)
        values = criterion.value(M + blocks.matrices(candidates))
        chosen.append(int(candidates[values.argmax()]))
        M = M + blocks.matrices(np.array(chosen[-1:]))[0]
    return np.array(chosen)


def rounded_weights(allowed: Allowed, weights: Array, rng: np.random.Generator | None) -> IntArray:
    """A whole plan from weights of the candidates, shape (n,): the largest, or drawn in proportion.

    The draw divides the weights by exponential noise, so a sort is a draw without replacement.
    """
    keys = weights + 1e-9
    return allowed.best(keys if rng is None else keys / rng.exponential(size=len(keys)))[1]


def _move_level(posed: Selection, plan: IntArray, value: float) -> IntArray | None:
    """The first exchange of a whole level that pays, its poses chosen greedily."""
    criterion, blocks, allowed = posed.criterion, posed.blocks, posed.allowed
    group = allowed.group[plan]
    scores = blocks.scores(criterion.gradient(blocks.total(plan)))
    for old in np.unique(group):
        rest = plan[group != old]
        others = allowed.positions[np.unique(group[group != old])]
        gaps = np.abs(allowed.positions[:, None] - others)
        near = (gaps < max(allowed.separation - 1e-12, 1e-12)).any(axis=1)
        for new in np.flatnonzero(~near):
            members, count = allowed.members[new], int(allowed.counts[new])
            if new == old or len(members) < count:
                continue
            promising = members[np.argsort(-scores[members])[:_PROMISING]]
            part = replace(blocks.take(promising), fixed=blocks.total(rest))
            added = greedy(Selection(criterion, part, Allowed.any_of(len(promising), count)))
            moved = np.concatenate([rest, promising[added]])
            if posed.value(moved) > value * (1.0 + _WORTH):
                return moved
    return None
