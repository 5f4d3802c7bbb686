"""Branch and bound: the proof that a plan is the best of a pool, or a better plan.

A node says how many poses come from each of some regions of candidates. Its relaxation gives a bound by
the same certificate as everywhere, and reduced costs shut candidates out. Then the region is cut in two
whose weights are the farthest from whole numbers, and every way to share its poses is a node below. The
best bound goes first, so that stopping early still leaves a valid one.
"""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from calib.arrays import Array, IntArray
from doe.optimal.allowed import Allowed, bound, survivors
from doe.optimal.blocks import Blocks
from doe.optimal.exchange import exchange
from doe.optimal.function import InformationFunction
from doe.optimal.regions import Cut, Regions, cut_of
from doe.optimal.relax import Relaxation, relax

_FINEST, _COARSEST = 1e-8, 1e-3  # of a node's relaxation, relative
_DIGITS = 0.05  # of the gap that is left, by which a node's relaxation may be off: its bound holds
_NEAR = 0.98  # of the best plan, from which a node's rounded weights are improved
_OVERHEAD = 1e6  # of a node, in multiplications
_LIKELY = 6  # candidates of a node's relaxation for each pose, about
_FEWEST = 20  # nodes that the work must be enough for; fewer close no gap
_SAME = 1e-9  # relative difference of two plans that is rounding

SHORT_WORK = 2.5e8
"""Multiplications of about a second."""


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
    """Regions, one of them cut in two.

    likely : ndarray of int, candidates that had weight before the cut
    before : int, poses before the cut, the others beyond it
    onward : int, -1 or 1: on which side of the weights, with fewer poses before the cut or with more
    """

    whole: Regions
    likely: IntArray
    cut: Cut | None = None
    before: int = 0
    onward: int = 0

    def regions(self) -> Regions:
        if self.cut is None:
            return self.whole
        return self.whole.cut(self.cut.beyond, self.cut.region, self.before)

    def farther(self) -> Iterator[_Node]:
        """The other ways to share the poses on this side of the weights, the nearest first."""
        if self.cut is None:
            return
        end = -1 if self.onward < 0 else int(self.whole.counts[self.cut.region]) + 1
        for before in range(self.before + self.onward, end, self.onward):
            other = replace(self, before=before)
            if other.regions().feasible:
                yield other


def _sides(whole: Regions, cut: Cut, likely: IntArray) -> Iterator[Iterator[_Node]]:
    """The nodes below, on either side of the weights, the nearest first."""
    fewer = min(int(np.floor(cut.before)), int(whole.counts[cut.region]) - 1)
    for before, onward in ((fewer, -1), (fewer + 1, 1)):
        yield _Node(whole, likely, cut, before - onward, onward).farther()


@dataclass(eq=False)
class _Tree:
    """A search by branch and bound: its open nodes, and the best plan so far.

    heap : open nodes, the best bound first; tried : plans that weights were rounded to
    work : float, multiplications, about
    """

    criterion: InformationFunction
    blocks: Blocks
    allowed: Allowed
    plan: IntArray
    value: float
    nodes: int = 0
    work: float = 0.0
    heap: list[tuple[float, int, _Node]] = field(default_factory=list)
    tried: set[bytes] = field(default_factory=set)
    ticket: Iterator[int] = field(default_factory=itertools.count)

    @property
    def enough(self) -> float:
        """A plan up to here is no better than the one in hand."""
        return self.value * (1.0 + _SAME)

    @property
    def bound(self) -> float:
        """No plan is better; what was shut out may be so by rounding."""
        left = -self.heap[0][0] if self.heap else 0.0
        return max(left, self.enough)

    def push(self, bound: float, node: _Node) -> None:
        heapq.heappush(self.heap, (-bound, next(self.ticket), node))

    def grow(self) -> None:
        """Take the node of the largest bound and open those below it."""
        above, _, node = heapq.heappop(self.heap)
        regions = node.regions()
        self.nodes += 1
        part = self.blocks.take(regions.index)
        relaxed = self._relaxed(part, regions, node, -above / self.value - 1.0)
        self._round(regions, relaxed)
        left = min(relaxed.bound, -above)
        self._open_farther(node, relaxed.G, -above)
        if left > self.enough:
            self._open_below(part, regions, relaxed, left)

    def _relaxed(self, part: Blocks, regions: Regions, node: _Node, gap: float) -> Relaxation:
        relaxed = relax(
            self.criterion, part, regions.allowed,
            start=np.flatnonzero(np.isin(regions.index, node.likely)),
            gap=float(np.clip(_DIGITS * gap, _FINEST, _COARSEST)), enough=self.enough,
        )  # fmt: skip
        self.work += self.work_of(len(part), len(relaxed.index), relaxed.rounds)
        return relaxed

    def work_of(self, live: int, likely: int, rounds: int) -> float:
        """Multiplications of a node, about: pricing, and the second order of the likely candidates."""
        priced, second = live * self.blocks.packed.shape[1], (likely * len(self.blocks.fixed)) ** 2
        return _OVERHEAD + rounds * float(priced + second)

    def _round(self, regions: Regions, relaxed: Relaxation) -> None:
        """Keep a node's weights rounded and improved where that is better than the plan in hand."""
        w = np.bincount(relaxed.index, relaxed.weights, len(regions.index))
        chosen: IntArray = np.sort(regions.allowed.best(w.astype(float))[1])
        key = regions.index[chosen].tobytes()
        part, rules = self.blocks.take(regions.index), self.allowed.take(regions.index)
        if key in self.tried or self.criterion.value(part.total(chosen)) < _NEAR * self.value:
            return
        self.tried.add(key)
        better, _ = exchange(self.criterion, part, rules, chosen)
        value = float(self.criterion.value(part.total(better)))
        if value > self.enough:
            self.plan, self.value = regions.index[better], value

    def _open_farther(self, node: _Node, G: Array, above: float) -> None:
        """The next node on this side that a better plan may be in, by the bound of this one's G."""
        fixed, scores = float((G * self.blocks.fixed).sum()), self.blocks.scores(G)
        for other in node.farther():
            regions = other.regions()
            found = min(fixed + regions.allowed.best(scores[regions.index])[0], above)
            if found > self.enough:
                self.push(found, other)
                break

    def _open_below(self, part: Blocks, regions: Regions, relaxed: Relaxation, left: float) -> None:
        kept = survivors(relaxed.G, part, regions.allowed, self.enough)
        w = np.bincount(relaxed.index, relaxed.weights, len(regions.index))
        likely, regions = regions.index[relaxed.index], regions.take(kept)
        cut = cut_of(self.criterion, part.take(kept), regions, relaxed.M, w[kept])
        if cut is not None:  # else one plan is left, and that was judged
            for side in _sides(regions, cut, likely):
                for child in itertools.islice(side, 1):
                    self.push(left, child)


def provable(criterion: InformationFunction, allowed: Allowed) -> bool:
    """Whether branch and bound is for such a problem: a smooth criterion, levels given."""
    return criterion.smooth and not allowed.chooses_levels


def prove(
    criterion: InformationFunction,
    blocks: Blocks,
    allowed: Allowed,
    plan: IntArray,
    G: Array,
    *,
    most_work: float = SHORT_WORK,
    told: Callable[[Proof], None] = lambda _: None,
) -> Proof:
    """Prove a plan, or find a better one, where that is :func:`provable`.

    G : ndarray, shape (p, p), supergradient of the root's bound
    most_work : multiplications after which it stops, about; told : called after every node
    Returns the best plan and the bound that is left. Where the work is enough for a few nodes alone,
    none is opened.
    """
    value = float(criterion.value(blocks.total(plan)))
    live = np.union1d(survivors(G, blocks, allowed, value * (1.0 + _SAME)), plan)
    part, rules = blocks.take(live), allowed.take(live)
    tree = _Tree(criterion, part, rules, np.searchsorted(live, plan), value)
    whole = Regions(np.arange(len(live)), rules.group, rules.counts, rules.repeats)
    tree.push(bound(G, blocks, allowed), _Node(whole, tree.plan))

    def proof() -> Proof:
        return Proof(live[tree.plan], tree.value, tree.bound, tree.nodes)

    if most_work < _FEWEST * tree.work_of(len(live), _LIKELY * len(plan), 1):
        return proof()
    while tree.heap and -tree.heap[0][0] > tree.enough and tree.work < most_work:
        tree.grow()
        told(proof())
    return proof()
