"""Which sets of candidates make a plan, and which of these has the largest sum of scores."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Self

import numpy as np

from calib.arrays import Array, IntArray


@dataclass(frozen=True, eq=False)
class Allowed:
    """Plans of ``used`` levels with so many poses each; without levels all come from one group.

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
        """Largest sum of scores of a plan, and its candidates, shape (size,); none: -inf."""
        tops = self._tops(scores)
        short = [len(top) < count for top, count in zip(tops, self.counts, strict=True)]
        totals = np.where(short, -np.inf, [scores[top].sum() for top in tops])
        total, levels = float(totals.sum()), tuple(range(len(tops)))
        if self.chooses_levels:
            total, levels = self._best_levels(totals)
        return total, np.concatenate([self.group[:0], *(tops[level] for level in levels)])

    def leading(self, scores: Array, counts: IntArray) -> IntArray:
        """So many of the best candidates of each level (L,), all where there are fewer."""
        return np.concatenate(
            [_largest(m, scores, k) for m, k in zip(self.members, counts.tolist(), strict=True)]
        )

    def _tops(self, scores: Array) -> list[IntArray]:
        """Best candidates of each level, fewer than a plan needs where it has too few."""
        tops = []
        for members, k in zip(self.members, self.counts.tolist(), strict=True):
            if self.repeats and k and len(members):
                tops.append(np.repeat(members[scores[members].argmax()], k))
            else:
                tops.append(_largest(members, scores, k))
        return tops

    def _best_levels(self, totals: Array) -> tuple[float, tuple[int, ...]]:
        """Largest sum of levels that keep their distance, and these: along the joint."""
        # Number of levels below each one that are far enough away to go with it.
        far = np.searchsorted(self.positions, self.positions - self.separation + 1e-12, "right")
        far = np.minimum(far, np.arange(len(totals)))

        @cache
        def best(count: int, below: int) -> tuple[float, tuple[int, ...]]:
            """Of so many among the first levels."""
            if not count or below < count:
                return (-np.inf if count else 0.0), ()
            total, levels = best(count - 1, int(far[below - 1]))
            with_last = total + float(totals[below - 1]), (*levels, below - 1)
            return max(best(count, below - 1), with_last)

        total, levels = best(self.used, len(totals))
        return total, levels if np.isfinite(total) else ()

    def admits(self, plan: IntArray) -> bool:
        """Whether candidates make a plan by the rules."""
        counts = np.bincount(self.group[plan], minlength=len(self.positions))
        used = np.flatnonzero(counts)
        apart = np.diff(self.positions[used]).min(initial=np.inf) >= self.separation - 1e-9
        full = len(used) == self.used and bool((counts[used] == self.counts[used]).all())
        return bool(apart) and full and (self.repeats or len(np.unique(plan)) == len(plan))

    def thresholds(self, scores: Array) -> Array:
        """Score that a candidate of each level must reach to enter the best plan, shape (L,)."""
        tops = zip(self._tops(scores), self.counts, strict=True)
        return np.array([scores[t].min() if len(t) and len(t) >= k else np.inf for t, k in tops])


def _largest(members: IntArray, scores: Array, count: int) -> IntArray:
    """So many of some candidates with the largest scores, all where there are fewer."""
    rest = len(members) - count
    if count == 0 or rest <= 0:
        return members[:count]
    return members[np.argpartition(scores[members], rest)[rest:]]
