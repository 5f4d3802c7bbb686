"""Branch and bound: the proof that a plan is the best of a pool, or a better plan.

A node says how many poses come from each of some levels, sets of candidates. Its relaxation gives a
bound by the same certificate as everywhere, and reduced costs shut candidates out. Then the level is
cut in two whose weights are the farthest from whole numbers, and every way to share its poses is a node
below. The best bound goes first, so that stopping early still leaves a valid one.

A dense pool has neighbours of every candidate that are as good. To shut one out says nothing, but to
say how many poses stand on either side of a plane between them does: the weights have to become whole
there, however many candidates there are.
"""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from calib.arrays import Array, IntArray, Mask
from doe.optimal.allowed import Allowed
from doe.optimal.blocks import unpack
from doe.optimal.exchange import exchange
from doe.optimal.relax import Relaxation, relax
from doe.optimal.selection import Selection

_FINEST, _COARSEST = 1e-8, 1e-3  # of a node's relaxation, relative
_DIGITS = 0.05  # of the gap that is left, by which a node's relaxation may be off: its bound holds
_NEAR = 0.98  # of the best plan, from which a node's rounded weights are improved
_OVERHEAD = 1e6  # of a node, in multiplications
_LIKELY = 6  # candidates of a node's relaxation for each pose, about
_FEWEST = 20  # nodes that the work must be enough for; fewer close no gap
_SOME = 1e-3  # weight from which a candidate counts where planes are laid
_WHOLE = 1e-6  # what a count may be off and still be whole
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
class _Cut:
    """A plane that divides the candidates of one level in two.

    beyond : ndarray of bool, shape (n,), its candidates on the far side; before : float, weight on the
    near side
    """

    level: int
    beyond: Mask
    before: float


@dataclass(frozen=True, eq=False)
class _Node:
    """Candidates and the rules over them, one level cut in two.

    index : ndarray of int, shape (n,); rules : Allowed, over these
    likely : ndarray of int, candidates that had weight before the cut
    before : int, poses before the cut, the others beyond it
    onward : int, -1 or 1: on which side of the weights, with fewer poses before the cut or with more
    """

    index: IntArray
    rules: Allowed
    likely: IntArray
    cut: _Cut | None = None
    before: int = 0
    onward: int = 0

    def left(self) -> tuple[IntArray, Allowed]:
        """Candidates that the cut leaves, and the rules over them."""
        if self.cut is None:
            return self.index, self.rules
        kept, rules = self.rules.divided(self.cut.beyond, self.cut.level, self.before)
        return self.index[kept], rules

    def farther(self) -> Iterator[_Node]:
        """The other ways to share the poses on this side of the weights, the nearest first."""
        if self.cut is None:
            return
        end = -1 if self.onward < 0 else int(self.rules.counts[self.cut.level]) + 1
        for before in range(self.before + self.onward, end, self.onward):
            other = replace(self, before=before)
            if other.left()[1].feasible:
                yield other


def _below(whole: _Node, cut: _Cut) -> Iterator[_Node]:
    """The node below on either side of the weights, the nearest that there is."""
    fewer = min(int(np.floor(cut.before)), int(whole.rules.counts[cut.level]) - 1)
    for before, onward in ((fewer, -1), (fewer + 1, 1)):
        side = replace(whole, cut=cut, before=before - onward, onward=onward)
        yield from itertools.islice(side.farther(), 1)


@dataclass(eq=False)
class _Tree:
    """A search by branch and bound: its open nodes, and the best plan so far.

    heap : open nodes, the best bound first; tried : plans that weights were rounded to
    work : float, multiplications, about
    """

    posed: Selection
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
        index, rules = node.left()
        self.nodes += 1
        part = replace(self.posed, blocks=self.posed.blocks.take(index), allowed=rules)
        start = np.flatnonzero(np.isin(index, node.likely))
        relaxed = self._relaxed(part, start, -above / self.value - 1.0)
        w = np.bincount(relaxed.index, relaxed.weights, len(index)).astype(float)
        self._round(index, part, np.sort(rules.best(w)[1]))
        self._open_farther(node, relaxed.G, -above)
        reachable = min(relaxed.bound, -above)
        if reachable <= self.enough:
            return
        kept = part.survivors(relaxed.G, self.enough)
        below = _Node(index[kept], rules.take(kept), index[relaxed.index])
        cut = _cut_of(part.take(kept), relaxed.M, w[kept])
        if cut is not None:  # else one plan is left, and that was judged
            for child in _below(below, cut):
                self.push(reachable, child)

    def _relaxed(self, part: Selection, start: IntArray, gap: float) -> Relaxation:
        gap = float(np.clip(_DIGITS * gap, _FINEST, _COARSEST))
        relaxed = relax(part, start=start, gap=gap, enough=self.enough)
        self.work += self.work_of(len(part), len(relaxed.index), relaxed.rounds)
        return relaxed

    def work_of(self, live: int, likely: int, rounds: int) -> float:
        """Multiplications of a node, about: pricing, and the second order of the likely candidates."""
        p = len(self.posed.blocks.fixed)
        priced, second = live * self.posed.blocks.packed.shape[1], (likely * p) ** 2
        return _OVERHEAD + rounds * float(priced + second)

    def _round(self, index: IntArray, part: Selection, chosen: IntArray) -> None:
        """Keep a node's rounded weights, improved, where that is better than the plan in hand.

        chosen : ndarray of int, shape (N,), the plan among the candidates ``index``
        """
        key = index[chosen].tobytes()
        if key in self.tried or part.value(chosen) < _NEAR * self.value:
            return
        self.tried.add(key)
        better, _ = exchange(replace(part, allowed=self.posed.allowed.take(index)), chosen)
        value = part.value(better)
        if value > self.enough:
            self.plan, self.value = index[better], value

    def _open_farther(self, node: _Node, G: Array, above: float) -> None:
        """The next node on this side that a better plan may be in, by the bound of this one's G."""
        blocks = self.posed.blocks
        fixed, scores = float((G * blocks.fixed).sum()), blocks.scores(G)
        for other in node.farther():
            index, rules = other.left()
            found = min(fixed + rules.best(scores[index])[0], above)
            if found > self.enough:
                self.push(found, other)
                break


def provable(posed: Selection) -> bool:
    """Whether branch and bound is for such a problem: a smooth criterion, levels given."""
    return posed.criterion.smooth and not posed.allowed.chooses_levels


def prove(
    posed: Selection,
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
    value = posed.value(plan)
    live = np.union1d(posed.survivors(G, value * (1.0 + _SAME)), plan)
    part = posed.take(live)
    tree = _Tree(part, np.searchsorted(live, plan), value)
    tree.push(posed.bound(G), _Node(np.arange(len(live)), part.allowed, tree.plan))

    def proof() -> Proof:
        return Proof(live[tree.plan], tree.value, tree.bound, tree.nodes)

    if most_work < _FEWEST * tree.work_of(len(live), _LIKELY * len(plan), 1):
        return proof()
    while tree.heap and -tree.heap[0][0] > tree.enough and tree.work < most_work:
        tree.grow()
        told(proof())
    return proof()


def _cut_of(part: Selection, M: Array, w: Array) -> _Cut | None:
    """The cut that weights w (n,) pay most to meet in whole numbers; None where no level divides.

    M : ndarray, shape (p, p), the information that they make
    Distances are those of the criterion's second order at M, in which a weight that moves by d over a
    distance x costs ``(d x)^2 / 2``. Planes stand between two candidates of weight, across their line.
    """
    held, packed, rules = np.flatnonzero(w > _SOME), part.blocks.packed, part.allowed
    turn = part.criterion.curvature(M, unpack(np.eye(packed.shape[1])))[2]
    at, group = packed[held] @ turn, rules.group[held]
    planes = {g: _plane(at[group == g], w[held][group == g]) for g in np.unique(group).tolist()}
    level, plane = max(planes.items(), key=lambda pair: pair[1].worth, default=(0, _NOWHERE))
    if plane.worth > 0.0:
        inside = rules.group == level
        beyond = inside & (packed @ (turn @ plane.normal) > plane.middle)
        if beyond.any() and (inside & ~beyond).any():  # else rounding has put all on one side
            return _Cut(level, beyond, plane.before)
    return _one_and_others(rules, w)


@dataclass(frozen=True, eq=False)
class _Plane:
    """Across a line in the direction of ``normal`` (d,), where it stands along it.

    worth : float, 0 where the weights before it are whole; before : float, their sum
    """

    worth: float
    normal: Array
    middle: float
    before: float


_NOWHERE = _Plane(0.0, np.zeros(1), 0.0, 0.0)


def _plane(at: Array, w: Array) -> _Plane:
    """The best plane between two of k points (k, d) of weights w (k,)."""
    if len(at) < 2:
        return _NOWHERE
    gram = at @ at.T
    first, second = np.triu_indices(len(at), 1)
    along = gram[first] - gram[second]
    length = gram[first, first] + gram[second, second] - 2.0 * gram[first, second]
    order = np.argsort(along, axis=1)
    along = np.take_along_axis(along, order, axis=1)
    before = np.cumsum(w[order], axis=1)[:, :-1]
    part, gap = np.abs(before - np.round(before)), np.diff(along, axis=1)
    worth = np.where(part > _WHOLE, part**2 * gap**2, 0.0) / np.maximum(length, 1e-300)[:, None]
    pair, place = np.unravel_index(worth.argmax(), worth.shape)
    return _Plane(
        worth=float(worth[pair, place]),
        normal=at[first[pair]] - at[second[pair]],
        middle=0.5 * float(along[pair, place] + along[pair, place + 1]),
        before=float(before[pair, place]),
    )


def _one_and_others(rules: Allowed, w: Array) -> _Cut | None:
    """Weights are whole: the heaviest candidate of a level that has others from the rest of it."""
    held = np.bincount(rules.group, minlength=len(rules.counts))
    most = rules.counts if not rules.repeats else np.ones_like(rules.counts)
    divides = (held > most)[rules.group]
    if not divides.any():
        return None
    one = int(np.where(divides, w, -1.0).argmax())
    level = int(rules.group[one])
    beyond = rules.group == level
    beyond[one] = False
    return _Cut(level, beyond, float(w[one]))
