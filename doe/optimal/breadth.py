"""How widely plans are searched: few poses need more starts, for their local optima are far apart."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from doe.optimal.allowed import Allowed

_FEW = 30  # poses up to which each is so large a part of all that first orders mislead
_FEWEST = 12  # poses up to which no candidate is passed over by its first order
_EVERYONE = 2**31  # more than any pool has
_CLOSELY = 200  # candidates in place of each pose that are ranked closely where poses are more
_EASED = (0.3, 0.1, 0.03, 0.01)  # information of average poses, per pose, that plans begin with
_WHOLE_WAY = (18, 168)  # their starts that then go on without: at least, and over the poses
_MORE_EASED = 4  # times as many that begin
_EVEN = 0.7  # share of them that does not heed the weights, which say little of so few poses
_BEST_OF_FEWEST, _BEST_OF_FEW, _KICKS_OF_FEW = 8, 4, 3
_BEST = (6, 12)  # where poses are more: at least, at most
_MORE = 4  # parameters for each of them: where there are many, local optima are many too


@dataclass(frozen=True)
class Breadth:
    """How many plans a search begins with and goes on from.

    starts : int; even : int, of these drawn without heed of the weights
    best : int, plans to breed from; kicks : int, plans bred of each, beside one by crossing
    eased : tuple of float, information of average poses, per pose, that helps a plan on its way
    whole : int, starts that go on without it, a third as many of those that are bred
    closely : int, candidates in place of each pose that are ranked by what they bring
    """

    starts: int
    even: int
    best: int
    kicks: int
    eased: tuple[float, ...] = ()
    whole: int = 0
    closely: int = 0


def breadth_of(allowed: Allowed, p: int) -> Breadth:
    """How widely plans for p parameters are searched."""
    if allowed.size > _FEW or allowed.chooses_levels:
        best = int(np.clip(p // _MORE, *_BEST))
        return Breadth(2 * best, 0, best, 1)
    whole = max(_WHOLE_WAY[0], _WHOLE_WAY[1] // allowed.size)
    starts = _MORE_EASED * whole
    even = round(_EVEN * starts)
    best, closely = _BEST_OF_FEW, _CLOSELY
    if allowed.size <= _FEWEST:
        best, closely = _BEST_OF_FEWEST, _EVERYONE
    return Breadth(starts, even, best, _KICKS_OF_FEW, _EASED, whole, closely)
