"""What a plan can tell of causes that no model has yet, before anything is measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from calib.api import Plan
from calib.arrays import Array, IntArray
from calib.cell import Cell
from calib.diagnosis.screen import Field
from calib.threads import one_blas_thread
from doe.prospect.detectability import Detectability, detectability_of
from doe.prospect.likeness import Likeness, likeness, plausible
from doe.prospect.view import View, view_of

_AT_ONCE = 1.05  # times the smallest size: who is told apart by then never looks alike


@dataclass(frozen=True, eq=False)
class PowerAnalysis:
    """What a plan can tell, cause by cause and pair by pair.

    view : View
    seen : tuple of Detectability, E of them; hidden : the same of what cannot be seen
    alike : Likeness, of those seen, None where there are none
    times : ndarray, shape (E, E), multiple of a cause's smallest size (row) from which on it is told
        from another (column); at most one where it always is once it is seen, infinite where never
    """

    view: View
    seen: tuple[Detectability, ...]
    hidden: tuple[Detectability, ...]
    alike: Likeness | None
    times: Array

    @property
    def confounded(self) -> tuple[tuple[int, ...], ...]:
        """Groups of causes, by position, that stand for each other at these poses at any size."""
        if self.alike is None:
            return ()
        groups = {tuple(np.flatnonzero(row).tolist()) for row in self.alike.confounded}
        return tuple(sorted(group for group in groups if len(group) > 1))

    @property
    def pairs(self) -> list[tuple[int, int]]:
        """Causes of just visible size and what they are taken for, the hardest to tell first."""
        found = [(int(i), int(j)) for i, j in np.argwhere(self.times > _AT_ONCE)]
        return sorted(found, key=lambda pair: -self.times[pair])

    @property
    def order(self) -> list[int]:
        """Those with look-alikes, each beside the causes that it is taken for."""
        from scipy.cluster.hierarchy import leaves_list, linkage
        from scipy.spatial.distance import squareform

        members = np.unique(np.array(self.pairs, dtype=int))
        if len(members) < 2:
            return []
        either = np.maximum(self.times, self.times.T)[np.ix_(members, members)]
        distance = 1.0 / np.maximum(either, 1.0)
        np.fill_diagonal(distance, 0.0)
        tree = linkage(squareform(distance), method="average", optimal_ordering=True)
        return [int(members[i]) for i in leaves_list(tree)]


@one_blas_thread
def foresee(cell: Cell, plan: Plan, *, values: Array | None = None) -> PowerAnalysis:
    """Smallest sizes, hidden causes and look-alikes of a plan, before anything is measured.

    plan : poses, a plan's file or joint values; read free and loaded where the cell has a [load]. Of
        measurements the points are ignored
    values : ndarray, shape (p,), SI, where the model is linearised; nominal, and as soft as usual,
        without them

    A size is found nine times in ten by the score test of the diagnosis, among all that it asks. A
    cause is told from another where the right one is preferred in 95 of 100 cases.

    Raises UnknownEffect, EffectCannotAct, TooFewPoses, CalibError.
    """
    view = view_of(cell, plan, values)
    every = [detectability_of(view, i) for i in range(len(view.suspects))]
    seen = tuple(found for found in every if found.directions)
    hidden = tuple(found for found in every if not found.directions)
    if not seen:
        return PowerAnalysis(view, (), hidden, None, np.zeros((0, 0)))
    columns = [own for own, found in zip(view.columns, every, strict=True) if found.directions]
    sizes, needed = [found.sizes for found in seen], [found.needed for found in seen]
    return PowerAnalysis(view, seen, hidden, *told_apart(view.field, columns, sizes, needed))


def told_apart(
    field: Field, columns: Sequence[IntArray], sizes: Sequence[Array], needed: Sequence[float]
) -> tuple[Likeness, Array]:
    """How alike causes with these columns are, and ``times`` of them, shape (E, E).

    sizes : of each, plausible sizes of its parameters, SI; needed : noncentrality that is found
    """
    at = np.concatenate(list(columns))
    X, ends = field.X[:, at], np.cumsum([0, *map(len, columns)])
    own = [np.arange(a, b) for a, b in pairwise(ends)]
    alike = likeness(X.T @ X, field.lengths[at], own, [plausible(size) for size in sizes])
    times: Array = np.sqrt(alike.needed(field.rows) / np.array(needed)[:, None])
    np.fill_diagonal(times, 0.0)
    return alike, times
