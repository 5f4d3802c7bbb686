"""Branch and bound: the proof that a plan is the best of a pool, where few candidates survive.

A node fixes some candidates into the plan and shuts others out. Its relaxation gives a bound by the
same certificate as everywhere, reduced costs shut out more, and the candidate branches that costs
most to force, by the second-order model of the interior point method. The best bound goes first, so
that stopping early still leaves a valid one.
"""

from __future__ import annotations

import heapq
import itertools
from dataclasses import dataclass, replace

import numpy as np

from calib.arrays import Array, IntArray
from doe.optimal.allowed import Allowed
from doe.optimal.blocks import Blocks
from doe.optimal.certify import bound, survivors
from doe.optimal.exchange import exchange
from doe.optimal.function import InformationFunction
from doe.optimal.newton import newton_weights

_FINEST, _COARSEST = 1e-6, 1e-3  # of a node's weights, relative
_DIGITS = 0.02  # of the gap that is left, the precision of a node's weights: its bound holds anyway
_FRACTION = 1e-3  # weights closer to 0 or 1 than this count as whole
_SAME = 1e-9  # relative difference of two plans that is rounding


@dataclass(frozen=True, eq=False)
class Proof:
    """What branch and bound found.

    plan : ndarray of int, candidates; value : float, its criterion
    bound : float, no plan of the pool is better
    nodes : int
    """

    plan: IntArray
    value: float
    bound: float
    nodes: int

    @property
    def optimal(self) -> bool:
        """Whether the plan is proved to be the best of the pool."""
        return self.bound <= self.value * (1.0 + 10.0 * _SAME)


@dataclass(frozen=True, eq=False)
class _Node:
    inside: IntArray  # candidates fixed into the plan
    free: IntArray  # candidates that may still enter


def prove(
    criterion: InformationFunction,
    blocks: Blocks,
    allowed: Allowed,
    plan: IntArray,
    G: Array,
    *,
    most_nodes: int = 500,
) -> Proof:
    """Prove a plan, or find a better one: a smooth criterion, levels given, candidates used once.

    G : ndarray, shape (p, p), supergradient of the root's bound
    Returns the best plan and the bound that is left after ``most_nodes``.
    """
    value = float(criterion.value(blocks.total(plan)))
    everyone = survivors(G, blocks, allowed, value * (1.0 + _SAME))
    root = _Node(np.zeros(0, dtype=int), np.union1d(everyone, plan))
    ticket = itertools.count()
    heap = [(-bound(G, blocks, allowed), next(ticket), root)]
    nodes, tried = 0, set[bytes]()
    while heap and nodes < most_nodes and -heap[0][0] > value * (1.0 + _SAME):
        gap = -heap[0][0] / value - 1.0
        _, _, node = heapq.heappop(heap)
        nodes += 1
        found, children, better = _branch(criterion, blocks, allowed, node, value, gap, tried)
        if better is not None:
            plan, value = better
        if found > value * (1.0 + _SAME):
            for child in children:
                heapq.heappush(heap, (-found, next(ticket), child))
    left = max([-heap[0][0]] if heap else [value])
    return Proof(plan, value, max(left, value), nodes)


def _branch(
    criterion: InformationFunction,
    blocks: Blocks,
    allowed: Allowed,
    node: _Node,
    value: float,
    gap: float,
    tried: set[bytes],
) -> tuple[float, list[_Node], tuple[IntArray, float] | None]:
    """Bound of a node, the nodes below it, and a better plan if one was met.

    tried : plans that weights were rounded to; added to
    """
    taken = np.bincount(allowed.group[node.inside], minlength=len(allowed.positions))
    rules = replace(allowed.take(node.free), counts=allowed.counts - taken)
    part = Blocks(blocks.packed[node.free], blocks.total(node.inside), blocks.rank)
    if (rules.counts < 0).any() or any(
        len(members) < count for members, count in zip(rules.members, rules.counts, strict=True)
    ):
        return -np.inf, [], None
    if not rules.size:
        return (
            float(criterion.value(part.fixed)),
            [],
            _judged(criterion, blocks, node.inside, value),
        )
    open_level = rules.counts[rules.group] > 0
    node = _Node(node.inside, node.free[open_level])
    part, rules = part.take(np.flatnonzero(open_level)), rules.take(np.flatnonzero(open_level))
    w = newton_weights(criterion, part, rules, float(np.clip(_DIGITS * gap, _FINEST, _COARSEST)))
    M = part.total(np.arange(len(w)), w)
    G = criterion.gradient(M)
    found = bound(G, part, rules)
    better = _rounded(criterion, blocks, allowed, rules, node, w, value, tried)
    if better is not None:
        value = better[1]
    if found <= value * (1.0 + _SAME):
        return found, [], better
    kept = survivors(G, part, rules, value * (1.0 + _SAME))
    if not len(kept):
        return value, [], better
    split = kept[_pull(criterion, part, rules, M, w)[kept].argmax()]
    rest = node.free[kept[kept != split]]
    into = np.append(node.inside, node.free[split])
    return found, [_Node(into, rest), _Node(node.inside, rest)], better


def _pull(
    criterion: InformationFunction, part: Blocks, rules: Allowed, M: Array, w: Array
) -> Array:
    """What it costs to force each candidate in or out, to second order, shape (q,).

    A weight moved by delta, the others following, costs ``delta^2 / (2 K_jj)`` with K the inverse of
    the Hessian on the directions that keep the sum of every level.
    """
    fractional = np.flatnonzero((w > _FRACTION) & (w < 1.0 - _FRACTION))
    cost = 1e-9 * (0.5 - np.abs(w - 0.5))
    if len(fractional) < 2:
        return cost
    _, _, rows = criterion.curvature(M, part.matrices(fractional))
    H = rows @ rows.T
    H[np.diag_indices(len(H))] += 1e-6 * np.trace(H) / len(H)
    K = np.linalg.inv(H)
    sums = (rules.group[fractional] == np.unique(rules.group[fractional])[:, None]).astype(float)
    follow = K @ sums.T
    K = K - follow @ np.linalg.solve(sums @ follow, follow.T)
    delta = np.minimum(w[fractional], 1.0 - w[fractional])
    cost[fractional] += delta**2 / np.maximum(np.diag(K), 1e-300)
    return cost


def _rounded(
    criterion: InformationFunction,
    blocks: Blocks,
    allowed: Allowed,
    rules: Allowed,
    node: _Node,
    w: Array,
    value: float,
    tried: set[bytes],
) -> tuple[IntArray, float] | None:
    """The node's weights rounded and improved, where first met and near the best plan."""
    _, chosen = rules.best(w)
    plan = np.sort(np.concatenate([node.inside, node.free[chosen]]))
    if (key := plan.tobytes()) in tried:
        return None
    tried.add(key)
    near = float(criterion.value(blocks.total(plan)))
    if near < 0.98 * value:
        return None
    whole = np.union1d(node.free, plan)
    plan, _ = exchange(
        criterion, blocks.take(whole), allowed.take(whole), np.searchsorted(whole, plan)
    )
    return _judged(criterion, blocks, whole[plan], value)


def _judged(
    criterion: InformationFunction, blocks: Blocks, plan: IntArray, value: float
) -> tuple[IntArray, float] | None:
    found = float(criterion.value(blocks.total(plan)))
    return (plan, found) if found > value * (1.0 + _SAME) else None
