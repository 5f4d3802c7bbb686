"""A plan that survives: best after the loss of whichever one pose it can least spare.

The criterion after the worst loss, ``min_i Phi(M - M_i)``, is no function of M, but concavity bounds
it: the smallest is at most the mean, and the mean at most ``Phi`` of the mean, ``(N - 1) / N`` of M.
"""

from __future__ import annotations

import numpy as np

from calib.arrays import Array, IntArray
from doe.optimal.allowed import Allowed
from doe.optimal.blocks import Blocks
from doe.optimal.function import InformationFunction

_TRIED = 60  # candidates of the largest scores that are tried in place of each pose
_WORTH = 1e-6


def smallest_left(criterion: InformationFunction, M: Array, blocks: Array) -> float:
    """The criterion after the worst loss of one pose; blocks : ndarray, shape (N, p, p)."""
    return float(criterion.value(M - blocks + 1e-12 * np.eye(len(M))).min())


def robust_exchange(
    criterion: InformationFunction, blocks: Blocks, allowed: Allowed, plan: IntArray
) -> IntArray:
    """Exchange single poses while the criterion after the worst loss grows."""
    plan = plan.copy()
    best = smallest_left(criterion, blocks.total(plan), blocks.matrices(plan))
    improved = True
    while improved:
        improved = False
        for slot in range(len(plan)):
            found = _better(criterion, blocks, allowed, plan, slot, best)
            if found is not None:
                plan[slot], best = found
                improved = True
    return plan


def _better(
    criterion: InformationFunction,
    blocks: Blocks,
    allowed: Allowed,
    plan: IntArray,
    slot: int,
    best: float,
) -> tuple[int, float] | None:
    M, own = blocks.total(plan), blocks.matrices(plan)
    here = allowed.members[allowed.group[plan[slot]]]
    free = here if allowed.repeats else np.setdiff1d(here, plan)
    # What the plan lacks most is what it lacks after its worst loss.
    worst = int(criterion.value(M - own).argmin())
    scores = blocks.take(free).scores(criterion.gradient(M - own[worst]))
    tried = free[np.argsort(-scores)[:_TRIED]]
    added = blocks.matrices(tried)
    base = M - own[slot]
    others = np.delete(own, slot, axis=0)
    left = criterion.value(base + added[:, None] - others).min(axis=1)
    left = np.minimum(left, criterion.value(base))
    top = int(left.argmax()) if len(left) else -1
    if top < 0 or left[top] <= best * (1.0 + _WORTH):
        return None
    return int(tried[top]), float(left[top])
