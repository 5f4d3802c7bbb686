"""Accuracy against the number of poses: where more of them stop paying."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from doe.assess import assess
from doe.plan import CurveStep, Design
from doe.problem import Problem
from doe.problem.pool import Pool
from doe.problem.request import CannotIdentify
from doe.solve import Progress, choose

_STEPS = 8
_PAYS = 0.05  # squared error times poses, above its least, that is still as good


def accuracy_curve(problem: Problem, pool: Pool) -> tuple[CurveStep, ...]:
    """Plans of the same candidates with fewer and with more poses, up to twice as many."""
    steps = []
    for smaller in _sizes(problem):
        try:
            chosen = choose(smaller, pool, Progress(), thorough=False)
        except CannotIdentify:
            continue
        judged = assess(smaller, pool.q[chosen.plan])
        steps.append(
            CurveStep(
                smaller.request.poses,
                judged.value,
                judged.task_rms,
                min(1.0, chosen.value / chosen.relaxed.bound),
            )
        )
    return tuple(steps)


def _sizes(problem: Problem) -> list[Problem]:
    request, rows = problem.request, int(problem.model.readout.channels.rows.sum())
    least = -(-len(problem.model.parameters) // rows)
    if request.levels is not None:
        counts = range(1, 2 * request.levels.per_level + 1)
        levels = [replace(request.levels, per_level=k) for k in counts]
        requests = [replace(request, levels=own, poses=own.poses) for own in levels]
    else:
        sizes = np.unique(
            np.geomspace(max(least, 2), 2 * request.poses, _STEPS).round().astype(int)
        )
        requests = [replace(request, poses=int(n)) for n in np.union1d(sizes, [request.poses])]
    return [replace(problem, request=own) for own in requests]


def stops_paying(counts: Sequence[int], errors: Sequence[float]) -> int | None:
    """The count of poses or readings from which on more of them only average noise; None for none.

    counts, errors : as many of each, expected RMS error in any unit
    Then the squared error falls as one over their number: twice the poses for a third off the error.
    With fewer, every further pose does more than that.
    """
    if not counts:
        return None
    work = np.array(counts) * np.array(errors) ** 2
    return counts[int(np.flatnonzero(work <= (1.0 + _PAYS) * work.min())[0])]


def poses_that_match(steps: tuple[CurveStep, ...], design: Design) -> dict[str, int | None]:
    """Fewest poses of an optimal plan that do what each plan judged beside it does, by name."""
    larger = design.problem.criterion.larger_is_better
    found: dict[str, int | None] = {}
    for name, rival in design.rivals.items():
        value = rival.assessment.value
        good = [s.poses for s in steps if (s.value >= value if larger else s.value <= value)]
        found[name] = min(good) if good else None
    return found
