"""Best subsets: the few named causes that explain what an unnamed curve does.

A curve may eat several causes at once, each of which explains too little alone to be preferred to it.
They are preferred together where each pays beside the others, nothing significant of the curve is left
beside them, and they explain the data as well as it did for their price. A cause that is in no
catalogue leaves a curve beside any few names, or is the better bargain, and stays without one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from calib.arrays import Array, IntArray
from calib.diagnosis.screen import Field, Score, score, weighted_test

_MOST = 3  # causes in one curve
_LEFT = 0.05  # probability below which something of a curve is left
_FOLLOWED = 8  # sets that are extended, the best of each size


@dataclass(frozen=True, eq=False)
class CauseSubset:
    """A set of named causes.

    members : tuple of int, positions among the named, in the order in which they were added
    gain : float, of all together; beside : Field, with their columns projected out as well
    """

    members: tuple[int, ...]
    gain: float
    complement: Field


def names_for_curve(
    field: Field,
    curve: IntArray,
    spread: Array,
    named: Sequence[IntArray],
    pays: Callable[[Score], bool],
) -> tuple[int, ...]:
    """The smallest set of up to three causes, positions in ``named``, to be preferred to a curve.

    Among sets of one size that with the largest gain; empty where there is none.
    field : Field, beside all that stays in the model, without the curve
    curve : ndarray of int, shape (k,), its columns; spread : ndarray, shape (k, k), as of ``score``
    named : columns of each cause by name; pays : whether a score earns its holder a place
    """
    ends = np.cumsum([0, len(curve), *map(len, named)])
    field = field.condensed(np.concatenate([curve, *named]))
    curve, *named = (np.arange(a, b) for a, b in pairwise(ends))
    least = score(field, curve, spread).gain
    followed = [CauseSubset((), 0.0, field)]
    for _ in range(_MOST):
        sets = sorted(_extended(followed, named, pays), key=lambda found: -found.gain)
        for found in sets:
            if (
                found.gain >= least
                and weighted_test(found.complement, curve, spread, mean=True)[0] >= _LEFT
                and _all_pay(field, found, named, pays)
            ):
                return found.members
        followed = sets[:_FOLLOWED]
    return ()


def _extended(
    sets: Sequence[CauseSubset], named: Sequence[IntArray], pays: Callable[[Score], bool]
) -> Iterator[CauseSubset]:
    """Each set with one cause more that pays beside it; sets of equal members once."""
    known: set[frozenset[int]] = set()
    for names in sets:
        scores = {
            i: found
            for i, columns in enumerate(named)
            if i not in names.members and pays(found := score(names.complement, columns))
        }
        for i in sorted(scores, key=lambda i: -scores[i].gain)[:_FOLLOWED]:
            members = (*names.members, i)
            if frozenset(members) not in known:
                known.add(frozenset(members))
                gain = names.gain + scores[i].gain
                yield CauseSubset(members, gain, names.complement.without(named[i]))


def _all_pay(
    field: Field, names: CauseSubset, named: Sequence[IntArray], pays: Callable[[Score], bool]
) -> bool:
    """Whether each cause pays beside the others."""
    for member in names.members:
        rest = field
        for other in names.members:
            if other != member:
                rest = rest.without(named[other])
        if not pays(score(rest, named[member])):
            return False
    return True
