"""From weights to the best whole plan found: many starts on a short list, then the whole pool."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, IntArray
from doe.optimal.allowed import Allowed
from doe.optimal.blocks import Blocks
from doe.optimal.certify import survivors
from doe.optimal.exchange import exchange, rounded_weights
from doe.optimal.function import InformationFunction
from doe.optimal.lockstep import crossed, improved, kicked
from doe.optimal.relax import Relaxation

_QUICK = 3  # starts where a search is not thorough
_FEW = 12  # poses up to which each tells so much that there are many local optima, far apart
_EASED = (0.3, 0.03)  # information of average poses, per pose, with which plans of few poses begin
_WHOLE_WAY = (18, 168)  # their starts that then go on without: at least, and over the poses
_MORE_EASED = 4  # times as many that begin
_EVEN = 0.7  # share that does not heed the weights, which say little of so few poses
_ROUNDS = 40  # of breeding, at most
_PATIENCE = 3  # rounds without a gain after which there are no more
_BEST_OF_FEW = 4  # plans from which others are bred
_BEST = (6, 12)  # where poses are more: at least, at most
_MORE = 4  # parameters for each of them: where there are many, local optima are many too
_KICKS_OF_FEW = 3  # of each that is bred from, and as many are crossed as there are
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
    """Search from many starts, then over every candidate that a better plan may contain.

    thorough : else from a few rounded weights alone, some per mille lower
    """
    rng = np.random.default_rng(seed)
    listed = _short_list(blocks, allowed, relaxed)
    part, rules = blocks.take(listed), allowed.take(listed)
    weights = np.zeros(len(listed))
    weights[np.searchsorted(listed, relaxed.index)] = relaxed.weights
    effort = _effort(rules, len(blocks.fixed))
    count, even = (effort.starts, effort.even) if thorough else (_QUICK, 0)
    everyone, same = np.arange(len(listed)), np.ones(len(listed))
    drawn = [
        rounded_weights(rules, everyone, same if k < even else weights, rng)
        for k in range(count - 1)
    ]
    first = np.array([rounded_weights(rules, everyone, weights, None), *drawn])
    plans, starts = _started(criterion, part, rules, first, effort)
    values = starts
    if thorough:
        plans, values = _bred(criterion, part, rules, plans, values, effort, rng)
    plan, value = listed[plans[values.argmax()]], float(values.max())
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


@dataclass(frozen=True)
class _Effort:
    """How wide a search is.

    starts : int; even : int, of these that do not heed the weights
    best : int, plans to breed from; kicks : int, plans bred of each
    eased : tuple of float, information of average poses; whole : int, starts that go on without
    """

    starts: int
    even: int
    best: int
    kicks: int
    eased: tuple[float, ...] = ()
    whole: int = 0


def _effort(allowed: Allowed, p: int) -> _Effort:
    if allowed.size > _FEW or allowed.chooses_levels:
        best = int(np.clip(p // _MORE, *_BEST))
        return _Effort(2 * best, 0, best, 1)
    whole = max(_WHOLE_WAY[0], _WHOLE_WAY[1] // allowed.size)
    starts = _MORE_EASED * whole
    return _Effort(starts, round(_EVEN * starts), _BEST_OF_FEW, _KICKS_OF_FEW, _EASED, whole)


def _started(
    criterion: InformationFunction,
    blocks: Blocks,
    allowed: Allowed,
    plans: IntArray,
    effort: _Effort,
) -> tuple[IntArray, Array]:
    if allowed.chooses_levels:
        found = [exchange(criterion, blocks, allowed, plan) for plan in plans]
        return np.array([plan for plan, _ in found]), np.array([value for _, value in found])
    return _settled(criterion, blocks, allowed, plans, effort.eased, effort.whole)


def _settled(
    criterion: InformationFunction,
    blocks: Blocks,
    allowed: Allowed,
    plans: IntArray,
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
    return improved(criterion, blocks, allowed, plans[np.argsort(-values)[:whole]], closely=True)


def _bred(
    criterion: InformationFunction,
    blocks: Blocks,
    allowed: Allowed,
    plans: IntArray,
    values: Array,
    effort: _Effort,
    rng: np.random.Generator,
) -> tuple[IntArray, Array]:
    """Plans kicked and crossed, improved, the best kept, until there is no gain for a while."""
    crossable = not (allowed.repeats or allowed.chooses_levels)
    idle = 0
    for _ in range(_ROUNDS):
        # One of those that ended alike: plans that differ.
        _, kept = np.unique(np.round(np.log(values) / _GAIN), return_index=True)
        kept = kept[::-1][: effort.best]
        plans, values = plans[kept], values[kept]
        children = [kicked(allowed, plan, rng) for plan in plans for _ in range(effort.kicks)]
        if crossable and len(plans) > 1:
            pairs = [rng.choice(len(plans), 2, replace=False) for _ in plans]
            children += [
                kicked(allowed, crossed(allowed, plans[a], plans[b], rng), rng) for a, b in pairs
            ]
        else:
            children += [kicked(allowed, plan, rng) for plan in plans]
        new, found = _settled(
            criterion, blocks, allowed, np.array(children), effort.eased[-1:], effort.whole // 3
        )
        idle = 0 if found.max() > values.max() * (1.0 + _GAIN) else idle + 1
        plans, values = np.concatenate([plans, new]), np.concatenate([values, found])
        if idle >= _PATIENCE:
            break
    return plans, values
