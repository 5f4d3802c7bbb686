"""From weights to the best whole plan: exchanges of one pose for a better candidate, started anew.

The criterion is concave, so a supergradient at the plan bounds every exchange from above by one dot
product. What could pay is ranked by what it brings to the other poses, exactly for D and for the
criteria that are a trace, and the best of it is judged exactly.

Exchanges end in local optima, so that they start anew until the best one is met again. Then a few poses
of the best plan, or of one nearly as good, are replaced by chance and it is improved again, until that
helps no more. Exchanges with all that the plan's gradient prices highest end the search.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.arrays import Array, IntArray
from doe.optimal.allowed import Allowed
from doe.optimal.blocks import downdated
from doe.optimal.function import Selection
from doe.optimal.relax import Relaxation

_CHEAP = 15_000  # poses of a plan times entries of a matrix: exchanges take no time
_JUDGED, _DOUBTED = 3, 24  # judged exactly in place of a pose, where their rank is exact or not
_RANKED = 100  # candidates of the largest price that are ranked where it does
_PROMISING = 200  # candidates of a level that is tried in place of another
_NEARLY = 0.9999  # of a pose is taken away: the rest alone may be singular
_ROUNDING = 1e-7  # relative gain below which an exchange is none
_QUICK = 3  # starts of a search that is not thorough
_FEWEST = 3  # starts before two that end in the same best plan are enough
_SAME = 1e-4  # relative difference of criteria below which two starts ended alike
_ACCEPTED = 0.997  # of the best plan, from which a plan is kicked in its place
_KICKED = 3  # poses of a plan that are replaced by chance, at most half of them
_SHORT = 1500  # candidates of a short list
_WORTH = 1e-6  # relative gain below which a plan is no better


@dataclass(frozen=True)
class _Effort:
    """How long a search goes on.

    starts : at most; kicks : of the best plan in vain, after which there are no more
    eased : information of average poses, per pose, that plans begin with
    """

    starts: int
    kicks: int
    eased: tuple[float, ...]


# Of few poses each is so large a part of all that local optima are many, and exchanges take no time.
_LONG, _BRIEF = _Effort(10, 40, (0.3, 0.1, 0.03, 0.01)), _Effort(3, 6, (0.3, 0.05))


@dataclass(frozen=True, eq=False)
class WholePlan:
    """The best plan found, with the weights that bound it.

    plan : ndarray of int, shape (N,), candidates; value : float, its criterion; relaxed : Relaxation
    """

    plan: IntArray
    value: float
    relaxed: Relaxation


def best_plan(
    posed: Selection, relaxed: Relaxation, *, seed: int, thorough: bool = True
) -> WholePlan:
    """Search by exchanges among the likely candidates, then among those that the plan prices highest.

    thorough : else from a few rounded weights alone, some per mille lower
    """
    rng = np.random.default_rng(seed)
    effort = _LONG if posed.allowed.size * posed.blocks.fixed.size <= _CHEAP else _BRIEF
    if not thorough:
        effort = replace(effort, starts=_QUICK, kicks=0)
    listed = _short_list(posed, relaxed.G, relaxed.index)
    part, weights = posed.take(listed), np.zeros(len(listed))
    weights[np.searchsorted(listed, relaxed.index)] = relaxed.weights
    ends = [_eased(part, rounded_weights(part.allowed, weights, None), effort)]
    while len(ends) < effort.starts and not _met_again(ends):
        # Of few poses the weights say little: every other start does not heed them.
        heeded = np.ones_like(weights) if thorough and len(ends) % 2 else weights
        ends.append(_eased(part, rounded_weights(part.allowed, heeded, rng), effort))
    plan, value = _kicked_on(part, *max(ends, key=lambda end: end[1]), effort.kicks, rng)
    plan, value = _among_all(posed, listed[plan], value)
    return WholePlan(plan, value, relaxed)


def rounded_weights(allowed: Allowed, weights: Array, rng: np.random.Generator | None) -> IntArray:
    """A whole plan from weights of the candidates, shape (n,): the largest, or drawn in proportion.

    The draw divides the weights by exponential noise, so a sort is a draw without replacement.
    """
    keys = weights + 1e-9
    return allowed.best(keys if rng is None else keys / rng.exponential(size=len(keys)))[1]


def _met_again(ends: list[tuple[IntArray, float]]) -> bool:
    """Whether the best of enough starts was reached twice, so that others are unlikely to beat it."""
    values = np.sort([value for _, value in ends])
    return len(ends) >= _FEWEST and bool(values[-2] >= values[-1] * (1.0 - _SAME))


def _eased(posed: Selection, plan: IntArray, effort: _Effort) -> tuple[IntArray, float]:
    """A local optimum by way of problems in which average poses help, ever less."""
    for share in effort.eased:
        helped = posed.blocks.plus(share * posed.allowed.size * posed.blocks.mean)
        plan, _ = exchange(replace(posed, blocks=helped), plan)
    return exchange(posed, plan)


def _kicked_on(
    part: Selection, plan: IntArray, value: float, kicks: int, rng: np.random.Generator
) -> tuple[IntArray, float]:
    """The best plan after kicks, until so many are in vain."""
    near, idle = plan, 0
    while idle < kicks:
        other, reached = exchange(part, _kicked(part.allowed, near, rng))
        idle += 1
        if reached > value * _ACCEPTED:
            near = other
        if reached > value * (1.0 + _WORTH):
            plan, value, idle = other, reached, 0
    return plan, value


def _kicked(allowed: Allowed, plan: IntArray, rng: np.random.Generator) -> IntArray:
    """A plan with a few of its poses replaced by chance, levels kept."""
    plan = plan.copy()
    for slot in rng.choice(len(plan), max(1, min(_KICKED, len(plan) // 2)), replace=False):
        members = allowed.members[allowed.group[plan[slot]]]
        free = members if allowed.repeats else np.setdiff1d(members, plan)
        if len(free):
            plan[slot] = rng.choice(free)
    return plan


def _among_all(posed: Selection, plan: IntArray, value: float) -> tuple[IntArray, float]:
    """Exchanges with the candidates that the gradient at the plan prices highest, until none helps."""
    while True:
        kept = _short_list(posed, posed.criterion.gradient(posed.blocks.total(plan)), plan)
        other, reached = exchange(posed.take(kept), np.searchsorted(kept, plan))
        if reached <= value * (1.0 + _WORTH):
            return kept[other], reached
        plan, value = kept[other], reached


def _short_list(posed: Selection, G: Array, always: IntArray) -> IntArray:
    """Candidates that are in any case, and of each level those that a supergradient prices highest."""
    counts = posed.allowed.counts
    many = np.maximum(counts + 5, _SHORT // len(counts))
    return np.union1d(always, posed.allowed.leading(posed.blocks.scores(G), many))


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
        likely = _likely(posed, plan, slot, prices, cov, value)
        base = M - blocks.matrices(plan[slot : slot + 1])[0]
        reached = criterion.value(base + blocks.matrices(likely))
        idle += 1
        if len(likely) and reached.max() > value * (1.0 + _ROUNDING):
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
    free = prices[here] > prices[plan[slot]] + value * _ROUNDING
    if not allowed.repeats:
        taken = np.zeros(len(allowed.group), dtype=bool)
        taken[plan] = True
        free &= ~taken[here]
    live: IntArray = here[free]
    judged = _JUDGED if criterion.smooth else _DOUBTED
    if len(live) <= judged:
        return live
    if len(plan) * cov.size > _CHEAP and len(live) > _RANKED:
        live = live[np.argpartition(-prices[live], _RANKED)[:_RANKED]]
    gain = criterion.gain(downdated(cov, rows[plan[slot]], _NEARLY), rows[live])
    best: IntArray = live[np.argpartition(-gain, judged)[:judged]]
    return best


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
            if posed.value(moved) > value * (1.0 + _ROUNDING):
                return moved
    return None


def greedy(posed: Selection) -> IntArray:
    """Fill a plan up without levels, each time with the candidate that adds most, shape (size,)."""
    M, chosen = posed.blocks.fixed, list[int]()
    free = np.ones(len(posed), dtype=bool)
    while len(chosen) < posed.allowed.size:
        candidates = np.flatnonzero(free)
        values = posed.criterion.value(M + posed.blocks.matrices(candidates))
        chosen.append(int(candidates[values.argmax()]))
        free[chosen[-1]] = posed.allowed.repeats
        M = M + posed.blocks.matrices(np.array(chosen[-1:]))[0]
    return np.array(chosen)
