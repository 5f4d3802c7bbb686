"""The figures of a design."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from calib.threads import one_blas_thread
from doe import Design
from studies.compare.anatomy import influence_by_effect
from studies.compare.experiment import POINTS, experiment_of
from studies.compare.prediction import predict
from studies.plots import accuracy, deviations, information
from studies.plots.style import Picture


@one_blas_thread
def pictures(design: Design) -> list[Picture]:
    """The proof, what each pose brings, the plans judged beside it, and the curve if there is one."""
    return list(_pictures(design))


def _pictures(design: Design) -> Iterator[Picture]:
    robot, view = design.problem.cell.robot, design.landscape
    joint = design.levels.joint if design.levels is not None else min(1, robot.dof - 1)
    yield information.derivative(
        view.share,
        view.q[:, joint],
        robot.joints[joint],
        np.flatnonzero(view.chosen),
        levels=None if design.levels is None else design.levels.values,
        criterion=design.criterion,
        efficiency=design.efficiency,
    )
    experiment = experiment_of(design.problem.cell, design.poses)
    share, groups = influence_by_effect(experiment, predict(experiment, POINTS), len(design.poses))
    yield information.by_pose(design.poses.names, share, groups)
    parameters = design.problem.model.parameters
    scales = np.array([p.scale for p in parameters])
    plans = {"this plan": design.assessment, **{n: r.assessment for n, r in design.rivals.items()}}
    yield deviations.by_approach(
        [p.id for p in parameters],
        [p.unit for p in parameters],
        {name: judged.std / scales for name, judged in plans.items()},
        title="Standard deviations by plan, approach #2",
    )
    if design.curve:
        rms = np.array([step.task_rms for step in design.curve])
        yield accuracy.against_poses([step.poses for step in design.curve], {"best plans": rms})
