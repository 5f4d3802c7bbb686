"""From weights to the best whole plan found: iterated local search.

Exchanges end in local optima, so that they start anew until the best one is met again. Then a few poses
of the best plan, or of one nearly as good, are replaced by chance and it is improved again, until that
helps no more. Exchanges with all that the plan's own gradient prices highest end the search.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.arrays import Array, IntArray
from doe.optimal.allowed import Allowed
from doe.optimal.exchange import CHEAP, exchange, rounded_weights
from doe.optimal.relax import Relaxation
from doe.optimal.selection import Selection

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
_LONG, _BRIEF = _Effort(10, 40, (0.3, 0.1, 0.03, 0.01)), _Effort(3, 10, (0.3, 0.05))


@dataclass(frozen=True, eq=False)
class WholePlan:
    """The best plan found, with the weights that bound it.

    plan : ndarray of int, shape (N,), candidates; value : float, its criterion
    agreement : float, median of the local optima that the starts ended in, over the best plan: where
        they agree, what is missing to the bound is likely the bound's slack
    relaxed : Relaxation
    """

    plan: IntArray
    value: float
    agreement: float
    relaxed: Relaxation


def best_plan(
    posed: Selection, relaxed: Relaxation, *, seed: int, thorough: bool = True
) -> WholePlan:
    """Search by exchanges among the likely candidates, then among those that the plan prices highest.

    thorough : else from a few rounded weights alone, some per mille lower
    """
    rng, entries = np.random.default_rng(seed), posed.blocks.fixed.size
    effort = _LONG if posed.allowed.size * entries <= CHEAP else _BRIEF
    listed = _short_list(posed, relaxed.G, relaxed.index)
    part, weights = posed.take(listed), np.zeros(len(listed))
    weights[np.searchsorted(listed, relaxed.index)] = relaxed.weights
    ends = [_eased(part, rounded_weights(part.allowed, weights, None), effort)]
    while len(ends) < (effort.starts if thorough else _QUICK) and not _met_again(ends):
        # Of few poses the weights say little: every other start does not heed them.
        heeded = np.ones_like(weights) if thorough and len(ends) % 2 else weights
        ends.append(_eased(part, rounded_weights(part.allowed, heeded, rng), effort))
    best = max(ends, key=lambda end: end[1])
    plan, value = _kicked_on(part, *best, effort, rng) if thorough else best
    plan, value = _among_all(posed, listed[plan], value)
    return WholePlan(plan, value, float(np.median([end for _, end in ends]) / value), relaxed)


def _kicked_on(
    part: Selection, plan: IntArray, value: float, effort: _Effort, rng: np.random.Generator
) -> tuple[IntArray, float]:
    """The best plan after kicks, until so many are in vain."""
    near, idle = plan, 0
    while idle < effort.kicks:
        other, reached = exchange(part, _kicked(part.allowed, near, rng))
        idle += 1
        if reached > value * _ACCEPTED:
            near = other
        if reached > value * (1.0 + _WORTH):
            plan, value, idle = other, reached, 0
    return plan, value


def _among_all(posed: Selection, plan: IntArray, value: float) -> tuple[IntArray, float]:
    """Exchanges with the candidates that the gradient at the plan prices highest, until none helps."""
    while True:
        kept = _short_list(posed, posed.criterion.gradient(posed.blocks.total(plan)), plan)
        other, reached = exchange(posed.take(kept), np.searchsorted(kept, plan))
        if reached <= value * (1.0 + _WORTH):
            return kept[other], reached
        plan, value = kept[other], reached


def _met_again(ends: list[tuple[IntArray, float]]) -> bool:
    """Whether the best of enough starts was reached twice, so that others are unlikely to beat it."""
    values = np.sort([value for _, value in ends])
    return len(ends) >= _FEWEST and bool(values[-2] >= values[-1] * (1.0 - _SAME))


def _eased(posed: Selection, plan: IntArray, effort: _Effort) -> tuple[IntArray, float]:
    """A local optimum by way of problems in which average poses help, ever less."""
    blocks = posed.blocks
    for share in effort.eased:
        helped = blocks.plus(share * posed.allowed.size * blocks.mean)
        plan, _ = exchange(replace(posed, blocks=helped), plan)
    return exchange(posed, plan)


def _short_list(posed: Selection, G: Array, always: IntArray) -> IntArray:
    """Candidates that are in any case, and of each level those that a supergradient prices highest."""
    scores, counts = posed.blocks.scores(G), posed.allowed.counts
    many = np.maximum(counts + 5, _SHORT // len(counts))
    return np.union1d(always, posed.allowed.leading(scores, many))


def _kicked(allowed: Allowed, plan: IntArray, rng: np.random.Generator) -> IntArray:
    """A plan with a few of its poses replaced by chance, levels kept."""
    plan = plan.copy()
    count = max(1, min(_KICKED, len(plan) // 2))
    for slot in rng.choice(len(plan), count, replace=False):
        members = allowed.members[allowed.group[plan[slot]]]
        free = members if allowed.repeats else np.setdiff1d(members, plan)
        if len(free):
            plan[slot] = rng.choice(free)
    return plan
