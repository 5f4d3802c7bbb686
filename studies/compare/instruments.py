"""One plan read by several instruments: what each leaves at the targets, and the arm by itself."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from calib.arrays import Array
from calib.cell import Cell
from calib.cell.targets import targets_of
from calib.errors import CalibError, InputError
from calib.files.tables import load_plan
from calib.poses import Poses
from studies.compare.experiment import POINTS, Experiment, experiment_of, refuse_unseen
from studies.compare.prediction import accuracy_at, predict

_PERFECT = 1e4  # times as good as stated: what is left then is the arm's own scatter


@dataclass(frozen=True, eq=False)
class Reading:
    """A plan as the instruments of one cell read it.

    task_rms, task_worst : float, m, expected at the targets, infinite where something stays open
    arm_rms : float, m, RMS that the arm's own scatter would leave with perfect instruments
    """

    cell: Cell
    plan: str
    poses: int
    task_rms: float
    task_worst: float
    arm_rms: float


def read_by_each(cells: Mapping[Path, Cell], plans: Mapping[str, Path]) -> Iterator[Reading]:
    """Every plan under every cell; the targets are those of the first.

    Raises InputError for a cell of another robot, and what :func:`experiment_of` raises.
    """
    (first, own), *others = cells.items()
    targets, weights = targets_of(own)
    for path, cell in others:
        if cell.robot.joints != own.robot.joints:
            raise InputError(path, "robot", f"has other joints than {first}", "compare one robot")
    for path, cell in cells.items():
        for name, file in plans.items():
            try:
                plan = load_plan(cell, file)
                experiment = experiment_of(cell, plan)
                refuse_unseen(experiment, name)
            except InputError:
                raise
            except CalibError as error:
                raise InputError(path, "", str(error)) from None
            ideal = replace(experiment, weights=experiment.weights * _PERFECT)
            rms, worst = _left(experiment, targets, weights)
            arm, _ = _left(ideal, targets, weights)
            yield Reading(cell, name, len(plan), rms, worst, arm)


def _left(experiment: Experiment, targets: Poses, weights: Array) -> tuple[float, float]:
    found = predict(experiment, POINTS)
    return accuracy_at(experiment, found.covariance, targets, weights)
