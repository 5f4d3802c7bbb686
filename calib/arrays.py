"""The kinds of arrays that pass from hand to hand; shapes and units stand where they are used."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
"""Figures, in SI and radians."""

IntArray: TypeAlias = NDArray[np.int_]
"""Positions, counts and groups."""

Mask: TypeAlias = NDArray[np.bool_]
"""Which of something: poses, markers, candidates, parameters."""

TextArray: TypeAlias = NDArray[np.str_]
"""Names that stand for each of something, and differ from one to another."""

_AT_ONCE = 2**21  # numbers

# glibc gives freed arrays above a threshold back to the system and asks for them again a moment later,
# up to a quarter of the time of a design. The threshold grows to the largest block that was freed, to
# 32 MB at most, so such a block is freed here; it is never touched, and takes no memory.
np.empty(2**25 - 2**14, dtype=np.uint8)


def room(batch: Sequence[int], *shape: int) -> Array:
    """Room for components ``shape`` of a batch, shape (*batch, *shape), one after the other in memory.

    Numpy's inner loops then run over the batch and not over three numbers: several times faster.
    """
    return batch_first(np.empty((*shape, *batch)), len(shape))


def batch_first(a: Array, n: int) -> Array:
    """The first n axes of an array after all others, a view."""
    return a.transpose(*range(n, a.ndim), *range(n))


def stacked(a: Array) -> Array:
    """All axes but the last as one, shape (.., k), even of no columns: ``reshape`` cannot tell."""
    return a.reshape(math.prod(a.shape[:-1]), a.shape[-1])


def in_parts(count: int, each: int) -> list[slice]:
    """Parts of so many things, with ``each`` numbers each, that the processor's cache holds."""
    step = max(1, _AT_ONCE // max(1, each))
    return [slice(first, first + step) for first in range(0, count, step)]


def by_size(group: IntArray) -> list[IntArray]:
    """Members (B, r) of the groups with r members, in their order, an array for each r.

    group : ndarray of int, shape (m,)
    """
    order = np.argsort(group, kind="stable")
    _, starts, counts = np.unique(group[order], return_index=True, return_counts=True)
    return [order[starts[counts == r][:, None] + np.arange(r)] for r in np.unique(counts).tolist()]
