"""Which sets of candidates make a plan, and which of these has the largest sum of scores."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from calib.arrays import Array, IntArray


@dataclass(frozen=True, eq=False)
class Allowed:
    """Plans of ``used`` levels with so many poses each.

    Without levels there is one group, from which all poses come.

    group : ndarray of int, shape (n,), level of each candidate, 0 .. L - 1
    positions : ndarray, shape (L,), rad or m, ascending: where the levels are
    counts : ndarray of int, shape (L,), poses at each level; all alike where levels are to be chosen
    used : int, levels that a plan uses: at most L, fewer when they are to be chosen
    separation : float, rad or m, the least distance of two levels that are used together
    repeats : bool, whether a candidate may be used more than once
    """

    group: IntArray
    positions: Array
    counts: IntArray
    used: int
    separation: float = 0.0
    repeats: bool = False

    @classmethod
    def any_of(cls, candidates: int, count: int, repeats: bool = False) -> Self:
        """Any so many of the candidates, without levels."""
        group = np.zeros(candidates, dtype=int)
        return cls(group, np.zeros(1), np.array([count]), 1, repeats=repeats)

    @property
    def size(self) -> int:
        """Number of poses of a plan."""
        return int(self.counts[0] * self.used if self.chooses_levels else self.counts.sum())

    @property
    def chooses_levels(self) -> bool:
        """Whether the levels are part of the choice."""
        return self.used < len(self.positions)

    @cached_property
    def members(self) -> tuple[IntArray, ...]:
        """Candidates of each level."""
        order = np.argsort(self.group, kind="stable")
        ends = np.searchsorted(self.group[order], np.arange(len(self.positions) + 1))
        return tuple(order[a:b] for a, b in itertools.pairwise(ends))

    def take(self, index: IntArray) -> Allowed:
        """The same rules over some of the candidates."""
        return replace(self, group=self.group[index])

    def best(self, scores: Array) -> tuple[float, IntArray]:
        """Largest sum of scores of a plan, and its candidates, shape (size,)."""
        tops = self._tops(scores)
        short = np.array([len(top) for top in tops]) < self.counts
        totals = np.where(short, -np.inf, [scores[top].sum() for top in tops])
        used = self._best_levels(totals)
        return float(totals[used].sum()), np.concatenate([tops[level] for level in used])

    def leading(self, scores: Array, counts: IntArray) -> IntArray:
        """So many of the best candidates of each level (L,), all where there are fewer."""
        return np.concatenate(
            [_largest(m, scores, k) for m, k in zip(self.members, counts.tolist(), strict=True)]
        )

    def again(self, scores: Array, count: int) -> IntArray:
        """Candidates whose second visits have the largest sum of scores, shape (count,)."""
        if self.repeats:
            return np.full(count, scores.argmax())
        return np.argsort(-scores)[:count]

    def _tops(self, scores: Array) -> list[IntArray]:
        """Best candidates of each level, none where it has too few."""
        found = []
        for members, k in zip(self.members, self.counts.tolist(), strict=True):
            if k == 0 or len(members) < (1 if self.repeats else k):
                found.append(members[:0])
            elif self.repeats:
                found.append(np.repeat(members[scores[members].argmax()], k))
            else:
                found.append(_largest(members, scores, k))
        return found

    def _best_levels(self, totals: Array) -> IntArray:
        """Levels of the largest sum that keep their distance: dynamic programming along the joint."""
        if not self.chooses_levels:
            return np.arange(len(totals))
        L = len(totals)
        # Number of levels below each one that are far enough away to go with it.
        far = np.searchsorted(self.positions, self.positions - self.separation + 1e-12, "right")
        far = np.minimum(far, np.arange(L))
        best = np.full((self.used + 1, L + 1), -np.inf)
        best[0] = 0.0
        taken = np.zeros((self.used + 1, L + 1), dtype=bool)
        for count, level in itertools.product(range(1, self.used + 1), range(L)):
            with_it = totals[level] + best[count - 1, far[level]]
            best[count, level + 1] = max(best[count, level], with_it)
            taken[count, level + 1] = with_it > best[count, level]
        used, level = [], L
        for count in range(self.used, 0, -1):
            while level > 0 and not taken[count, level]:
                level -= 1
            level -= 1
            used.append(level)
            level = int(far[level])
        return np.array(used[::-1])

    def admits(self, plan: IntArray) -> bool:
        """Whether candidates make a plan by the rules."""
        counts = np.bincount(self.group[plan], minlength=len(self.positions))
        used = np.flatnonzero(counts)
        apart = np.diff(self.positions[used]).min(initial=np.inf) >= self.separation - 1e-9
        full = len(used) == self.used and bool((counts[used] == self.counts[used]).all())
        return bool(apart) and full and (self.repeats or len(np.unique(plan)) == len(plan))

    def thresholds(self, scores: Array) -> Array:
        """Score that a candidate of each level must reach to enter the best plan, shape (L,)."""
        return np.array([scores[t].min() if len(t) else np.inf for t in self._tops(scores)])

    def forced(self, scores: Array) -> Array:
        """Upper bound on the sum of scores of a plan that contains each candidate, shape (n,)."""
        below = np.maximum(self.thresholds(scores)[self.group] - scores, 0.0)
        return np.asarray(self.best(scores)[0] - below)


def _largest(members: IntArray, scores: Array, count: int) -> IntArray:
    """So many of some candidates with the largest scores, all where there are fewer."""
    rest = len(members) - count
    if count == 0 or rest <= 0:
        return members[:count]
    return members[np.argpartition(scores[members], rest)[rest:]]
