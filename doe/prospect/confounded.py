"""What would tell confounded causes apart: the plan, and as many poses again in another way.

No list says which cause has which remedy: each change is tried after the plan, and the causes compared
again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from calib.arrays import Array, IntArray, stacked
from calib.diagnosis.candidates import Candidate
from calib.diagnosis.detection_limit import detectable
from calib.diagnosis.rounds import ALPHA
from calib.diagnosis.screen import field
from calib.diagnosis.stage import positions
from calib.model import Model
from calib.model.covariance import identifiable
from calib.threads import one_blas_thread
from doe.prospect.foresee import PowerAnalysis, told_apart
from doe.prospect.remedies import Change, changes, easiest
from doe.prospect.situation import situation_of

_WORTH = 5.0  # times its smallest size at which a cause must be told apart for a change to be named


@one_blas_thread
def remedies_of(found: PowerAnalysis) -> tuple[tuple[Change, ...], ...]:
    """Changes by which each group of confounded causes would be told apart, the easy ones first.

    A change counts if every two of the group are told apart from five times their smallest size on.
    """
    view, groups = found.view, found.confounded
    if not groups:
        return ()
    every = [found.seen[i].candidate for group in groups for i in group]
    model, values = view.model.extended(view.values, [c.effect for c in every])
    at = [positions(view.whole.model, effect) for effect in model.effects]
    rows = view.rows[:, np.concatenate(at)]
    situation = situation_of(replace(view.whole, model=model, values=values), view.data)
    q = situation.feasible(int(view.data.poses.configuration.max()) + 1, seed=0)
    named: list[list[Change]] = [[] for _ in groups]
    for change in changes(situation):
        allowed = change.situation.allowed(q)
        if not len(allowed):
            continue
        further = change.situation.in_order(allowed)
        # What only the further readings have is nothing to the plan.
        more = np.pad(rows, ((0, 0), (0, further.shape[-1] - rows.shape[1])))
        both = np.concatenate([more, stacked(further)])
        modelled = np.delete(np.arange(both.shape[1]), np.s_[len(view.values) : rows.shape[1]])
        for group, own in zip(groups, named, strict=True):
            members = [found.seen[i].candidate for i in group]
            if _worst_times(change.situation.model, both, modelled, members, view.asked) < _WORTH:
                own.append(change)
    return tuple(easiest(own, lambda change: change.name) for own in named)


def _worst_times(
    model: Model, rows: Array, modelled: IntArray, members: Sequence[Candidate], asked: int
) -> float:
    """Multiple of its smallest size from which on the worst of a group is told from the others."""
    sizes, ids = model.sizes[modelled], [model.parameters[i].id for i in modelled]
    kept = modelled[identifiable(rows[:, modelled], sizes, tuple(ids)).kept]
    at = [np.setdiff1d(positions(model, c.effect), model.tunings) for c in members]
    ends = np.cumsum([0, *map(len, at)])
    view = field(rows[:, kept], rows[:, np.concatenate(at)], np.zeros(len(rows)))
    columns = [np.arange(a, b) for a, b in pairwise(ends)]
    seen = [
        detectable(view, own, asked * c.tried, ALPHA)
        for own, c in zip(columns, members, strict=True)
    ]
    if not all(one.directions for one in seen):
        return np.inf
    plausible = [np.array([p.size for p in c.amounts]) for c in members]
    return float(told_apart(view, columns, plausible, [one.needed for one in seen])[1].max())
