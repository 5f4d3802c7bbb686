"""What a plan can tell of causes that no model has yet, before anything is measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.api import Plan
from calib.arrays import Array
from calib.cell import Cell
from calib.diagnosis.alike import Likeness, likeness
from calib.threads import one_blas_thread
from doe.foresight.sight import Sight, sight_of
from doe.foresight.view import View, view_of

_AT_ONCE = 1.05  # times the smallest size: who is told apart by then never looks alike


@dataclass(frozen=True, eq=False)
class Foresight:
    """What a plan can tell, cause by cause and pair by pair.

    view : View
    seen : tuple of Sight, E of them; hidden : tuple of Sight, what cannot be seen
    alike : Likeness, of those seen, None where there are none
    times : ndarray, shape (E, E), multiple of a cause's smallest size (row) from which on it is told
        from another (column); at most one where it always is once it is seen, infinite where never
    """

    view: View
    seen: tuple[Sight, ...]
    hidden: tuple[Sight, ...]
    alike: Likeness | None
    times: Array

    @property
    def just(self) -> Array:
        """Noncentrality of each cause at its smallest size, shape (E,)."""
        return np.array([sight.needed for sight in self.seen])

    @property
    def twins(self) -> tuple[tuple[int, ...], ...]:
        """Groups of causes, by position, that stand for each other at these poses at any size."""
        if self.alike is None:
            return ()
        groups = {tuple(np.flatnonzero(row).tolist()) for row in self.alike.twins}
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
def foresee(cell: Cell, plan: Plan, *, values: Array | None = None) -> Foresight:
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
    sights = [sight_of(view, i) for i in range(len(view.suspects))]
    positions = [i for i, sight in enumerate(sights) if sight.directions]
    seen = tuple(sights[i] for i in positions)
    hidden = tuple(sight for sight in sights if not sight.directions)
    if not seen:
        return Foresight(view, (), hidden, None, np.zeros((0, 0)))
    alike = likeness(view.field, [view.columns[i] for i in positions], [s.sizes for s in seen])
    times = np.sqrt(alike.needed() / np.array([s.needed for s in seen])[:, None])
    np.fill_diagonal(times, 0.0)
    return Foresight(view, seen, hidden, alike, times)
