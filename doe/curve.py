"""Accuracy against the number of poses: where more of them stop paying."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from doe.assess import assess
from doe.candidates import Pool
from doe.plan import CurveStep, Design
from doe.problem import Problem
from doe.request import CannotIdentify, Request
from doe.solve import choose

_STEPS = 8
_PAYS = 0.05  # squared error times poses, above its least, that is still as good


def accuracy_curve(problem: Problem, pool: Pool) -> tuple[CurveStep, ...]:
    """Plans of the same candidates with fewer and with more poses, up to twice as many."""
    steps = []
    for request in _sizes(problem):
        with suppress(CannotIdentify):
            sized = replace(problem, request=request)
            chosen = choose(sized, pool, thorough=False)
            judged = assess(sized, pool.q[chosen.plan])
            proved = min(1.0, chosen.value / chosen.relaxed.bound)
            steps.append(CurveStep(request.poses, judged.value, judged.task_rms, proved))
    return tuple(steps)


def _sizes(problem: Problem) -> Iterator[Request]:
    request = problem.request
    if request.levels is not None:
        for count in range(1, 2 * request.levels.per_level + 1):
            levels = replace(request.levels, per_level=count)
            yield replace(request, levels=levels, poses=levels.poses)
        return
    least = -(-len(problem.model.parameters) // int(problem.model.readout.channels.rows.sum()))
    sizes = np.geomspace(max(least, 2), 2 * request.poses, _STEPS).round().astype(int)
    for poses in np.union1d(sizes, request.poses).tolist():
        yield replace(request, poses=poses)


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
    sign = 1.0 if design.problem.criterion.larger_is_better else -1.0
    found: dict[str, int | None] = {}
    for name, rival in design.rivals.items():
        value = rival.assessment.value
        good = [s.poses for s in steps if sign * s.value >= sign * value]
        found[name] = min(good, default=None)
    return found
