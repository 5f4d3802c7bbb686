"""Whole plans: rounded and greedy starts, improved by exchanging one pose for a better candidate.

An exchange is judged exactly, but only where it could pay: the criterion is concave, so a supergradient
at any matrix bounds every exchange from above by one dot product. Where a criterion has a form for one
pose more, that bounds it within what little of the pose that leaves is kept beside the plan. Else the
bound is refined at the best exchange found so far (Kelley's cutting planes over the pool), and for D
the rank of a block bounds its determinant. A pose stays only where no candidate can beat it.
"""

from __future__ import annotations

import numpy as np

from calib.arrays import Array, IntArray
from doe.optimal.allowed import Allowed
from doe.optimal.blocks import Blocks
from doe.optimal.covariance import lessened
from doe.optimal.function import InformationFunction

_JUDGED = 24  # candidates in place of a pose that are judged exactly
_PROMISING = 200  # candidates of a level that is tried in place of another
_NEARLY = 0.9999  # of a pose is taken away: the rest alone may be singular
_WORTH = 1e-7  # relative gain below which an exchange is rounding


def exchange(
    criterion: InformationFunction,
    blocks: Blocks,
    allowed: Allowed,
    plan: IntArray,
    *,
    levels_too: bool = True,
) -> tuple[IntArray, float]:
    """Improve a plan until no single exchange does, nor one of a whole level where levels are chosen.

    plan : ndarray of int, shape (size,), candidates; left as it is
    Returns the plan and its criterion, never lower than before.
    """
    plan, value = _singles(criterion, blocks, allowed, plan.copy())
    while levels_too and allowed.chooses_levels:
        moved = _move_level(criterion, blocks, allowed, plan, value)
        if moved is None:
            break
        plan, value = _singles(criterion, blocks, allowed, moved)
    return plan, value


def _singles(
    criterion: InformationFunction, blocks: Blocks, allowed: Allowed, plan: IntArray
) -> tuple[IntArray, float]:
    """Single exchanges, one pose after the other, until none helps; changes the plan."""
    M = blocks.total(plan)
    value, idle, slot = float(criterion.value(M)), 0, 0
    G, cov = criterion.gradient(M), np.linalg.inv(M)
    while idle < len(plan):
        base = M - blocks.matrices(plan[slot : slot + 1])[0]
        likely = _likely(criterion, blocks, allowed, plan, slot, base, G, cov, value)
        reached = criterion.value(base + blocks.matrices(likely))
        idle += 1
        if len(likely) and reached.max() > value * (1.0 + _WORTH):
            plan[slot], value, idle = likely[reached.argmax()], float(reached.max()), 0
            M = blocks.total(plan)
            G, cov = criterion.gradient(M), np.linalg.inv(M)
        slot = (slot + 1) % len(plan)
    return plan, value


def _likely(
    criterion: InformationFunction,
    blocks: Blocks,
    allowed: Allowed,
    plan: IntArray,
    slot: int,
    base: Array,
    G: Array,
    cov: Array,
    value: float,
) -> IntArray:
    """Candidates in place of one pose that are worth an exact judgement.

    base : ndarray, shape (p, p), information without the pose
    G, cov : ndarray, shape (p, p), gradient and covariance with it
    """
    here = allowed.members[allowed.group[plan[slot]]]
    at_most = blocks.scores(G)[here] + float((G * base).sum())
    free = at_most > value * (1.0 + _WORTH)
    if not allowed.repeats:
        free &= ~np.isin(here, plan)
    live = here[free]
    if len(live) <= _JUDGED:
        return live
    rest = lessened(cov, blocks.rows[plan[slot]], _NEARLY)
    order = np.argpartition(-criterion.brought(rest, blocks.rows[live]), _JUDGED)
    return live[order[:_JUDGED]]


def greedy(criterion: InformationFunction, blocks: Blocks, allowed: Allowed) -> IntArray:
    """Fill a plan up, each time with the candidate that adds most.

    Levels that are to be chosen are settled first, by the plan that is best to first order.
    """
    counts = allowed.counts
    if allowed.chooses_levels:
        _, first = allowed.best(blocks.scores(criterion.gradient(blocks.fixed + blocks.mean)))
        counts = np.bincount(allowed.group[first], minlength=len(counts))
    chosen: list[int] = []
    M = blocks.fixed
    while len(chosen) < counts.sum():
        taken = np.bincount(allowed.group[chosen], minlength=len(counts)) if chosen else 0 * counts
        free = (taken < counts)[allowed.group]
        if not allowed.repeats:
            free[chosen] = False
        candidates = np.flatnonzero(free)
        values = criterion.value(M + blocks.matrices(candidates))
        best = int(candidates[values.argmax()])
        chosen.append(best)
        M = M + blocks.matrices(np.array([best]))[0]
    return np.array(chosen)


def rounded_weights(
    allowed: Allowed, weights: Array, rng: np.random.Generator | None
) -> IntArray:
    """A whole plan from weights of the candidates, shape (n,): the largest, or drawn in proportion.

    The draw divides the weights by exponential noise, so a sort is a draw without replacement.
    """
    keys = weights + 1e-9
    if rng is not None:
        keys = keys / rng.exponential(size=len(keys))
    return allowed.best(keys)[1]


def _move_level(
    criterion: InformationFunction, blocks: Blocks, allowed: Allowed, plan: IntArray, value: float
) -> IntArray | None:
    """The first exchange of a whole level that pays, its poses chosen greedily."""
    group = allowed.group[plan]
    scores = blocks.scores(criterion.gradient(blocks.total(plan)))
    for old in np.unique(group):
        rest = plan[group != old]
        others = allowed.positions[np.unique(group[group != old])]
        gaps = np.abs(allowed.positions[:, None] - others)
        near = (gaps < max(allowed.separation - 1e-12, 1e-12)).any(axis=1)
        for new in np.flatnonzero(~near):
            members, count = allowed.members[new], allowed.counts[new : new + 1]
            if new == old or len(members) < count[0]:
                continue
            promising = members[np.argsort(-scores[members])[:_PROMISING]]
            inside = Allowed(np.zeros(len(promising), dtype=int), np.zeros(1), count, 1)
            added = greedy(
                criterion, Blocks(blocks.packed[promising], blocks.total(rest), blocks.rank), inside
            )
            moved = np.concatenate([rest, promising[added]])
            if criterion.value(blocks.total(moved)) > value * (1.0 + _WORTH):
                return moved
    return None
