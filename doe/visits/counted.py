"""Second visits in the certificate of a plan, and what they cost.

A supergradient G bounds every matrix: ``Phi(M) <= <G, M>``. So no plan of N poses of which k are
visited again is above the bound of N poses plus the k largest scores ``<G, M_i>``, nor is any plan of
N + k poses that are visited once.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib.arrays import Array, IntArray
from doe.assess import assess
from doe.optimal.allowed import Allowed
from doe.optimal.exchange import greedy, smallest_left
from doe.plan import Certificate
from doe.problem import Problem
from doe.solve import Finished

_TRIED = 300  # candidates of the largest scores, to be visited in place of a pose twice


def with_second_visits(problem: Problem, found: Finished, q: Array) -> Certificate:
    """The certificate of the plan where poses q, shape (k, dof), of it are visited again."""
    plain, relaxed, before = problem.criterion.plain, found.relaxed, found.certificate
    blocks, again = problem.blocks(found.pool), problem.information(q)
    scores = blocks.scores(relaxed.G)
    best = problem.rules(found.pool.level).again(scores, len(q))
    own = np.concatenate([blocks.matrices(found.plan), again])
    M = blocks.fixed + own.sum(axis=0)
    return replace(
        before,
        value=float(plain.value(M)),
        bound=before.bound + float(scores[best].sum()),
        weighted=float(plain.value(relaxed.M + blocks.matrices(best).sum(axis=0))),
        left=smallest_left(plain, M, own),
    )


def new_poses_instead(problem: Problem, found: Finished, count: int) -> float:
    """Task RMS [m] with so many more poses in place of second visits, the others kept.

    The poses that add most to the problem's criterion, one after the other; NaN where there are none.
    """
    blocks, chosen = problem.blocks(found.pool), found.plan
    scores = blocks.scores(problem.criterion.gradient(blocks.total(chosen)))
    others = np.setdiff1d(np.arange(len(scores)), chosen)
    some: IntArray = others[np.argsort(-scores[others])[:_TRIED]]
    if len(some) < count:
        return np.nan
    anywhere = Allowed(np.zeros(len(some), dtype=int), np.zeros(1), np.array([count]), 1)
    beside = replace(blocks.take(some), fixed=blocks.total(chosen))
    more = some[greedy(problem.criterion, beside, anywhere)]
    return assess(problem, found.pool.q[np.concatenate([chosen, more])]).task_rms
