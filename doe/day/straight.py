"""Straight motions of the joints, and the proof that nothing is met on them.

A stretch of a motion is free where every constraint holds in its middle for longer than half of it
(:mod:`doe.constraints.clearance`). What is left on both sides is looked at in turn, until all is proved
or something is met. All motions are looked at together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, IntArray, Mask
from calib.cell import Cell
from doe.constraints import scene_of
from doe.constraints.clearance import Lasting, levers_of

_SHORTEST = 1e-5  # of a motion: a stretch that is not proved by then counts as met
_AT_ONCE = 4000  # configurations, so that memory stays bounded
_FREE = -1


@dataclass(frozen=True, eq=False)
class Straight:
    """n straight motions.

    met : ndarray of int, shape (n,), the first of the constraints that was found broken, -1 where all
        hold from end to end
    at : ndarray, shape (n,), share of the motion at which it was; NaN where all hold
    looked : int, configurations that were looked at
    """

    met: IntArray
    at: Array
    looked: int

    @property
    def free(self) -> Mask:
        """Motions on which all constraints hold, shape (n,)."""
        return np.asarray(self.met == _FREE)


def straight(cell: Cell, kept: Sequence[Lasting], start: Array, end: Array) -> Straight:
    """Whether constraints hold on motions from joint values (n, dof) to others, ends included."""
    met, at, looked = np.full(len(start), _FREE), np.full(len(start), np.nan), 0
    if not kept:
        return Straight(met, at, 0)
    travel = np.maximum(np.abs(start), np.abs(end)).max(axis=0, initial=0.0)
    levers, step = levers_of(cell, travel), end - start
    which, middle, half = np.arange(len(start)), np.full(len(start), 0.5), np.full(len(start), 0.5)
    while len(which):
        sure = np.empty((len(kept), len(which)))
        for part in np.array_split(np.arange(len(which)), -(-len(which) // _AT_ONCE)):
            own = which[part]
            scene = scene_of(cell, start[own] + middle[part, None] * step[own])
            rates = np.abs(step[own])
            sure[:, part] = [constraint.lasts(scene, rates, levers) for constraint in kept]
        looked += len(which)
        least, first = sure.min(axis=0), sure.argmin(axis=0)
        broken = least < _SHORTEST
        met[which[broken]], at[which[broken]] = first[broken], middle[broken]
        left = (least <= half) & (met[which] == _FREE)
        which, middle, half, least = (own[left] for own in (which, middle, half, least))
        away, rest = 0.5 * (half + least), 0.5 * (half - least)
        which, half = np.tile(which, 2), np.tile(rest, 2)
        middle = np.concatenate([middle - away, middle + away])
    return Straight(met, at, looked)
