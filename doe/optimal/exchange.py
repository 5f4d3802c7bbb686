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
from doe.optimal.packed import pack

_BATCH = 24
_PATIENCE = 2  # batches looked at after the first one that holds something better
_PROMISING = 200  # candidates of a level that is tried in place of another
_NEARLY = 0.9999  # of a pose is taken away: the rest alone may be singular
_DIGITS = 1e-9  # that an update of the covariance may lose, relative
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
    M = blocks.total(plan)
    G = criterion.gradient(M)
    value = float(criterion.value(M))
    idle = 0
    while idle < len(plan):
        for slot in range(len(plan)):
            found = _better(criterion, blocks, allowed, plan, slot, M, G, value)
            if found is None:
                idle += 1
            else:
                plan[slot], value = found
                M = blocks.total(plan)
                G = criterion.gradient(M)
                idle = 0
            if idle >= len(plan):
                break
    return plan, value


def _better(
    criterion: InformationFunction,
    blocks: Blocks,
    allowed: Allowed,
    plan: IntArray,
    slot: int,
    M: Array,
    G: Array,
    value: float,
) -> tuple[int, float] | None:
    """A better candidate in place of one pose, and the criterion with it; None if there is none.

    G : ndarray, shape (p, p), the gradient at M, the plan's information
    """
    here = allowed.members[allowed.group[plan[slot]]]
    rows = blocks.packed[here] if len(here) < len(blocks) else blocks.packed
    base = M - blocks.matrices(plan[slot : slot + 1])[0]
    possible = np.minimum(_above(G, base, rows), criterion.screen(base, rows, blocks.rank))
    if not allowed.repeats:
        taken = np.zeros(len(blocks), dtype=bool)
        taken[plan] = True
        possible[taken[here]] = -np.inf
    best, chosen = value * (1.0 + _WORTH), -1
    live = np.flatnonzero(possible > best)
    if len(live) > _BATCH:
        closer = _raised(criterion, blocks, plan[slot], here[live], M)
        possible[live] = np.minimum(possible[live], closer)
    patience = _PATIENCE
    while patience:
        live = np.flatnonzero(possible > best)
        if not len(live):
            break
        patience -= chosen >= 0
        if len(live) > _BATCH:
            live = live[np.argpartition(-possible[live], _BATCH)[:_BATCH]]
        values = criterion.value(base + blocks.matrices(here[live]))
        possible[live] = -np.inf
        top = int(values.argmax())
        if values[top] > best:
            best, chosen = float(values[top]), int(here[live[top]])
        nearest = base + blocks.matrices(here[live[top : top + 1]])[0]
        rest = np.flatnonzero(possible > best)
        if len(rest) > _BATCH:
            cut = _above(criterion.gradient(nearest), base, rows[rest])
            possible[rest] = np.minimum(possible[rest], cut)
    return None if chosen < 0 else (chosen, best)


def _raised(
    criterion: InformationFunction, blocks: Blocks, out: int, index: IntArray, M: Array
) -> Array:
    """Upper bounds on the criterion with candidates in place of a pose, of which a trace stays."""
    rows = blocks.take(np.append(index, out)).rows
    cov = np.asarray(np.linalg.inv(M))[None]
    rest = lessened(cov, rows[-1:], _NEARLY)[0]
    found = criterion.raised(rest, rows[:-1])
    return np.full(len(index), np.inf) if found is None else found * (1.0 + _DIGITS)


def _above(G: Array, base: Array, rows: Array) -> Array:
    """Upper bound on the criterion of ``base`` with each candidate added."""
    return np.asarray(rows @ pack(G) + float((G * base).sum()))


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
    allowed: Allowed, index: IntArray, weights: Array, rng: np.random.Generator | None
) -> IntArray:
    """A whole plan from weights of some candidates: the largest, or drawn in proportion.

    The draw multiplies the weights with exponential noise, so a sort is a draw without replacement.

    index, weights : ndarray, shape (k,), positions of candidates and what they weigh
    """
    keys = weights + 1e-9
    if rng is not None:
        keys = keys / rng.exponential(size=len(index))
    rules = allowed.take(index)
    _, chosen = rules.best(keys)
    return index[chosen]


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
