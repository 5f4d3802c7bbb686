"""Many plans improved side by side, and what is bred from the best of them.

Near its end an exchange finds that almost no candidate helps, and most of its work is to price them. Of
many plans that stand at one pose the pricing to first order is one product of two matrices, which costs
a part of as many products with a vector. Where poses are few each is so large a part of all that is
known that its first order says little: then candidates are ranked by what they bring, at many times
the cost. Only the first of them are judged exactly, by an update of the covariance: an exchange may be
missed. What ends on the best plan and misses none is :func:`doe.optimal.exchange.exchange`.
"""

from __future__ import annotations

import numpy as np

from calib.arrays import Array, IntArray
from doe.optimal.allowed import Allowed
from doe.optimal.blocks import Blocks
from doe.optimal.covariance import exchanged, lessened
from doe.optimal.function import InformationFunction
from doe.optimal.packed import pack

_JUDGED = 6  # candidates of the largest scores that are judged exactly in place of a pose
_JUDGED_CLOSELY = (
    2,
    32,
)  # where what they bring ranks them, or a smoother criterion than their own
_HALF = 0.5  # of a pose is taken away for a first order between what is without it and with it
_NEARLY = 0.9999  # of a pose is taken away to see what would come in its place
_WORTH = 1e-6  # relative gain below which an exchange is none
_KICKED = 3  # poses of a plan that are replaced by chance, at most half of them


def improved(
    criterion: InformationFunction,
    blocks: Blocks,
    allowed: Allowed,
    plans: IntArray,
    *,
    closely: int = 0,
) -> tuple[IntArray, Array]:
    """Improve plans by single exchanges, one pose after the other, until none of the likely ones helps.

    plans : ndarray of int, shape (B, size)
    closely : int, candidates in place of each pose that are ranked by what they bring, the best to
        first order
    Returns the plans, poses of a level together, and their criteria.
    """
    plans = np.take_along_axis(plans, np.argsort(allowed.group[plans], axis=1, kind="stable"), 1)
    parts = [(here, blocks.packed[here]) for here in allowed.members]
    rows = blocks.rows
    judged = _JUDGED_CLOSELY[not criterion.smooth] if closely else _JUDGED
    totals = np.array([blocks.total(plan) for plan in plans])
    values, cov = np.array(criterion.value(totals)), np.linalg.inv(totals)
    idle, slot = np.zeros(len(plans), dtype=int), 0
    while len(live := np.flatnonzero(idle < plans.shape[1])):
        idle[live] += 1
        levels = allowed.group[plans[live, slot]]
        for level in np.unique(levels):
            own = live[levels == level]
            out, (here, packed) = plans[own, slot], parts[level]
            scores = _scores(criterion, cov[own], rows[out], rows[here], packed, closely)
            if not allowed.repeats:
                taken = np.zeros((len(own), len(blocks)), dtype=bool)
                np.put_along_axis(taken, plans[own], True, axis=1)
                scores[taken[:, here]] = -np.inf
            top = _largest(scores, judged)
            found = criterion.value_by_covariance(exchanged(cov[own], rows[out], rows[here[top]]))
            found = np.where(np.take_along_axis(scores, top, 1) > -np.inf, found, -np.inf)
            best = np.take_along_axis(top, found.argmax(axis=1)[:, None], 1)[:, 0]
            gains = np.flatnonzero(found.max(axis=1) > values[own] * (1.0 + _WORTH))
            into, who = here[best[gains]], own[gains]
            moved = totals[who] + blocks.matrices(into) - blocks.matrices(out[gains])
            exact = criterion.value(moved)
            truly = exact > values[who] * (1.0 + _WORTH)
            who, moved = who[truly], moved[truly]
            plans[who, slot], totals[who], values[who] = into[truly], moved, exact[truly]
            cov[who], idle[who] = np.linalg.inv(moved), 0
        slot = (slot + 1) % plans.shape[1]
    return plans, values


def _scores(
    criterion: InformationFunction, cov: Array, out: Array, into: Array, packed: Array, closely: int
) -> Array:
    """What ranks candidates in place of one pose of each plan, shape (B, n).

    cov : ndarray, shape (B, p, p), of the plans; out : ndarray, shape (B, r, p), rows of the poses
    into, packed : rows (n, r, p) and information of the candidates; closely : as above
    """
    if closely < len(into):
        between = lessened(cov, out, _HALF)
        scores = np.asarray(pack(criterion.leaning(between)) @ packed.T)
        if not closely:
            return scores
    rests = lessened(cov, out, _NEARLY)
    if closely >= len(into):
        return np.array([criterion.brought(rest, into) for rest in rests])
    found = np.full_like(scores, -np.inf)
    for own, rest, some in zip(found, rests, _largest(scores, closely), strict=True):
        own[some] = criterion.brought(rest, into[some])
    return found


def _largest(scores: Array, count: int) -> IntArray:
    """Positions of the largest of each row, shape (B, count) or all of them."""
    if scores.shape[1] <= count:
        return np.broadcast_to(np.arange(scores.shape[1]), scores.shape)
    return np.argpartition(scores, -count, axis=1)[:, -count:]


def kicked(allowed: Allowed, plan: IntArray, rng: np.random.Generator) -> IntArray:
    """A plan with a few of its poses replaced by chance, levels kept."""
    plan = plan.copy()
    count = max(1, min(_KICKED, len(plan) // 2))
    for slot in rng.choice(len(plan), count, replace=False):
        members = allowed.members[allowed.group[plan[slot]]]
        free = members if allowed.repeats else np.setdiff1d(members, plan)
        if len(free):
            plan[slot] = rng.choice(free)
    return plan


def crossed(
    allowed: Allowed, first: IntArray, second: IntArray, rng: np.random.Generator
) -> IntArray:
    """A plan of what two plans share, filled up by chance from what only one of them has.

    For candidates that are used once and levels that are given: then the rules find one.
    """
    both, times = np.unique(np.concatenate([first, second]), return_counts=True)
    _, chosen = allowed.take(both).best(times + rng.uniform(0.0, 0.9, len(both)))
    return both[chosen]
