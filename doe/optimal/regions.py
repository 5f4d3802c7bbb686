"""Regions of candidates with so many poses in each, and the cut that a relaxation feels most.

A dense pool has neighbours of every candidate that are as good. To shut one out says nothing, but to
say how many poses stand on either side of a plane between them does: the weights have to become whole
there, however many candidates there are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, IntArray, Mask
from doe.optimal.allowed import Allowed
from doe.optimal.blocks import Blocks, unpack
from doe.optimal.function import InformationFunction

_SOME = 1e-3  # weight from which a candidate counts where planes are laid
_WHOLE = 1e-6  # what a count may be off and still be whole


@dataclass(frozen=True, eq=False)
class Regions:
    """Plans of so many poses from each of some sets of candidates.

    index : ndarray of int, shape (n,), candidates; group : ndarray of int, shape (n,), region of each
    counts : ndarray of int, shape (L,), poses in each; repeats : whether a candidate may be used again
    """

    index: IntArray
    group: IntArray
    counts: IntArray
    repeats: bool

    @property
    def allowed(self) -> Allowed:
        """The same as rules over the candidates."""
        count = len(self.counts)
        return Allowed(
            self.group, np.arange(float(count)), self.counts, count, repeats=self.repeats
        )

    @property
    def feasible(self) -> bool:
        """Whether every region has the candidates for its poses."""
        held = np.bincount(self.group, minlength=len(self.counts))
        return bool((held >= (np.minimum(self.counts, 1) if self.repeats else self.counts)).all())

    def take(self, kept: IntArray) -> Regions:
        """Some of the candidates, by their places in the index."""
        return Regions(self.index[kept], self.group[kept], self.counts, self.repeats)

    def cut(self, beyond: Mask, region: int, before: int) -> Regions:
        """A region in two: so many of its poses before the cut, the others beyond, (n,).

        Regions without a pose are no more.
        """
        group = np.where(beyond, len(self.counts), self.group)
        counts = np.append(self.counts, self.counts[region] - before)
        counts[region] = before
        held = counts > 0
        alive = held[group]
        return Regions(
            self.index[alive], (np.cumsum(held) - 1)[group[alive]], counts[held], self.repeats
        )


@dataclass(frozen=True, eq=False)
class Cut:
    """A plane that divides the candidates of one region in two.

    beyond : ndarray of bool, shape (n,), its candidates on the far side; before : float, weight on the
    near side
    """

    region: int
    beyond: Mask
    before: float


def cut_of(
    criterion: InformationFunction, part: Blocks, regions: Regions, M: Array, w: Array
) -> Cut | None:
    """The cut that weights w (n,) pay most to meet in whole numbers; None where no region divides.

    M : ndarray, shape (p, p), the information that they make
    Distances are those of the criterion's second order at M, in which a weight that moves by d over a
    distance x costs ``(d x)^2 / 2``. Planes stand between two candidates of weight, across their line.
    """
    held = np.flatnonzero(w > _SOME)
    turn = criterion.curvature(M, unpack(np.eye(part.packed.shape[1])))[2]
    at, group = part.packed[held] @ turn, regions.group[held]
    planes = {g: _plane(at[group == g], w[held][group == g]) for g in np.unique(group).tolist()}
    region, plane = max(planes.items(), key=lambda pair: pair[1].worth, default=(0, _NOWHERE))
    if plane.worth > 0.0:
        inside = regions.group == region
        beyond = inside & (part.packed @ (turn @ plane.normal) > plane.middle)
        if beyond.any() and (inside & ~beyond).any():  # else rounding has put all on one side
            return Cut(region, beyond, plane.before)
    return _one_and_others(regions, w)


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


def _one_and_others(regions: Regions, w: Array) -> Cut | None:
    """Weights are whole: the heaviest candidate of a region that has others from the rest of it."""
    held = np.bincount(regions.group, minlength=len(regions.counts))
    most = regions.counts if not regions.repeats else np.ones_like(regions.counts)
    divides = (held > most)[regions.group]
    if not divides.any():
        return None
    one = int(np.where(divides, w, -1.0).argmax())
    region = int(regions.group[one])
    beyond = regions.group == region
    beyond[one] = False
    return Cut(region, beyond, float(w[one]))
