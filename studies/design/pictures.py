"""The figures of a design."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import numpy as np

from studies.plots import accuracy, deviations, information
from studies.plots.style import Picture

if TYPE_CHECKING:
    from studies.design.record import DesignRecord, LandscapeEntry


def pictures(record: DesignRecord) -> Iterator[Callable[[], Picture]]:
    """The proof, what each pose brings, the plans judged beside it, and the curve if there is one."""
    landscape = record.landscape
    if landscape is not None:
        yield lambda: derivative(record, landscape)
    if record.by_pose and record.by_pose[0].effects:
        yield lambda: information_by_pose(record)
    yield lambda: deviations_by_plan(record)
    if record.curve:
        yield lambda: against_poses(record)


def derivative(record: DesignRecord, landscape: LandscapeEntry) -> Picture:
    """What the criterion would gain towards each candidate."""
    levels = landscape.levels_rad
    return information.derivative(
        np.array(landscape.share),
        np.array(landscape.value_rad),
        landscape.joint,
        np.arange(landscape.chosen),
        levels=None if levels is None else np.array(levels),
        criterion=record.criterion,
        efficiency=record.efficiency,
    )


def information_by_pose(record: DesignRecord) -> Picture:
    """What each pose tells of the parameters, by effect."""
    poses = record.by_pose
    return information.by_pose([own.pose for own in poses], [own.effects for own in poses])


def deviations_by_plan(record: DesignRecord) -> Picture:
    """Standard deviations of the plan and of those judged beside it."""
    plans = {"this plan": [p.std for p in record.predicted_std]}
    plans |= {name: list(own.std) for name, own in record.against.items() if own.std}
    return deviations.by_approach(
        [p.id for p in record.predicted_std],
        [p.unit for p in record.predicted_std],
        {name: np.array(std, dtype=float) for name, std in plans.items()},
        title="Uncertainty of each parameter, by plan",
    )


def against_poses(record: DesignRecord) -> Picture:
    """Accuracy of the best plans found of fewer and more poses."""
    rms = np.array([step.task_rms_mm for step in record.curve], dtype=float) / 1e3
    return accuracy.against_number([step.poses for step in record.curve], {"best plans": rms})
