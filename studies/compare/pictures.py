"""The figures of a comparison."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Literal

import numpy as np

from calib.arrays import Array
from studies.compare.agreement import band
from studies.plots import accuracy, deviations, ellipses, information
from studies.plots.style import Picture

if TYPE_CHECKING:
    from studies.compare.record import ByNumber, ComparedApproach, ComparedPlan, CompareRecord

Draw = Callable[[], Picture]

_MOST = 20  # plans that a figure can keep apart; the table holds them all


def pictures(record: CompareRecord) -> Iterator[Draw]:
    """Every figure, plan by plan; file names begin with the plan's where there are several."""
    if 1 < len(record.plans) <= _MOST:
        yield lambda: by_plan(record)
    for plan in record.plans:
        for draw in of_plan(plan):
            yield draw if len(record.plans) == 1 else partial(_named, plan, draw)


def _named(plan: ComparedPlan, draw: Draw) -> Picture:
    picture = draw()
    start = re.sub(r"[^\w.-]+", "_", plan.plan.removesuffix(".csv"))
    return replace(picture, name=f"{start}_{picture.name}", title=f"{plan.plan}: {picture.title}")


def by_plan(record: CompareRecord) -> Picture:
    """Standard deviations of approach #2 at every plan of the same parameters side by side."""
    first = record.plans[0]
    return deviations.by_approach(
        first.ids,
        _units(first),
        {plan.plan: _std(plan.points) for plan in record.plans if plan.ids == first.ids},
        name="plans",
        title="Uncertainty of each parameter, by plan (approach #2)",
    )


def of_plan(plan: ComparedPlan) -> Iterator[Draw]:
    """Figures of one plan, as far as the result holds what they show."""
    yield lambda: by_approach(plan)
    if any(own.agreement for own in plan.approaches):
        yield lambda: simulated(plan)
    if plan.entangled:
        yield lambda: entangled(plan)
    if plan.correlation:
        yield lambda: ellipses.correlation(plan.ids, np.array(plan.correlation, dtype=float))
    if plan.by_pose and plan.by_pose[0].effects:
        yield lambda: information_by_pose(plan)
    if plan.by_poses.counts:
        yield lambda: _against(plan.by_poses, "poses")
    if len(plan.by_markers.counts) > 1:
        yield lambda: _against(plan.by_markers, "markers")


def by_approach(plan: ComparedPlan) -> Picture:
    """Standard deviations by approach."""
    return deviations.by_approach(
        plan.ids, _units(plan), {own.key: _std(own) for own in plan.approaches}
    )


def simulated(plan: ComparedPlan) -> Picture:
    """Predicted and simulated ones, where there are trials."""
    tried = [own for own in plan.approaches if own.agreement]
    scatter = {
        own.key: np.array([p.monte_carlo_std for p in own.parameters], dtype=float) for own in tried
    }
    predicted = {own.key: _std(own) for own in tried}
    return deviations.predicted_against_simulated(
        plan.ids, _units(plan), predicted, scatter, plan.trials, band(plan.trials)
    )


def entangled(plan: ComparedPlan) -> Picture:
    """Error ellipses of the parameters that go together most."""
    unit, first = dict(zip(plan.ids, _units(plan), strict=True)), plan.entangled[0]
    return ellipses.ellipses(
        [(a, unit[a], b, unit[b]) for a, b in (pair.ids for pair in plan.entangled)],
        {k: np.array([pair.covariance[k] for pair in plan.entangled]) for k in first.covariance},
        {
            key: np.stack([np.array(pair.simulated[key]) for pair in plan.entangled], axis=1)
            for key in first.simulated
        },
    )


def information_by_pose(plan: ComparedPlan) -> Picture:
    """What each pose counts for, by effect."""
    poses = plan.by_pose
    return information.by_pose([own.pose for own in poses], [own.effects for own in poses])


def _against(curve: ByNumber, of: Literal["poses", "markers"]) -> Picture:
    rms = {key: np.array(v, dtype=float) / 1e3 for key, v in curve.task_rms_mm.items()}
    return accuracy.against_number(curve.counts, rms, of, "expected error, median of subsets")


def _units(plan: ComparedPlan) -> list[str]:
    return [p.unit for p in plan.points.parameters]


def _std(own: ComparedApproach) -> Array:
    return np.array([p.std for p in own.parameters], dtype=float)
