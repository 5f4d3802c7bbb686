"""A selection: which of some candidates make the best plan, and what no plan surpasses.

The linear oracle :meth:`~doe.optimal.allowed.Allowed.best` finds the plan of the largest sum of scores.
It is exact, which makes every bound built on it a bound over whole plans: for any positive definite M
the supergradient G of the criterion there bounds every plan, ``Phi <= <G, M_fixed> + max over plans of
sum <G, M_i>``. Nothing is assumed of where M came from, so a solver's inaccuracy can make the bound
loose, never wrong.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.arrays import Array, IntArray
from doe.optimal.allowed import Allowed
from doe.optimal.blocks import Blocks
from doe.optimal.function import InformationFunction


@dataclass(frozen=True, eq=False)
class Selection:
    """What is made large, what each candidate brings, and which sets of them make a plan.

    criterion : InformationFunction; blocks : Blocks, of n candidates; allowed : Allowed, over them
    """

    criterion: InformationFunction
    blocks: Blocks
    allowed: Allowed

    def __len__(self) -> int:
        return len(self.blocks)

    def take(self, index: IntArray) -> Selection:
        """The same over some of the candidates."""
        return replace(self, blocks=self.blocks.take(index), allowed=self.allowed.take(index))

    def by(self, criterion: InformationFunction) -> Selection:
        """The same by another criterion."""
        return replace(self, criterion=criterion)

    def value(self, plan: IntArray) -> float:
        """The criterion of a plan."""
        return float(self.criterion.value(self.blocks.total(plan)))

    def bound(self, G: Array) -> float:
        """No plan has a larger criterion than this, G, shape (p, p), being a supergradient."""
        own = float((G * self.blocks.fixed).sum())
        return own + self.allowed.best(self.blocks.scores(G))[0]

    def survivors(self, G: Array, value: float) -> IntArray:
        """Candidates that a plan better than ``value`` may contain (reduced-cost fixing).

        G : ndarray, shape (p, p), supergradient of the criterion
        """
        own = float((G * self.blocks.fixed).sum())
        return np.flatnonzero(own + self.allowed.forced(self.blocks.scores(G)) > value)
