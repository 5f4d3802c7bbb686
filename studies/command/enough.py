"""``posecal enough``: whether the poses measured so far will do, and which to measure next."""

from __future__ import annotations

from pathlib import Path

import click

from studies.command.deliver import check_outputs, deliver, output_file, working
from studies.command.options import (
    Finite,
    cell_argument,
    data_argument,
    faults_in,
    result_options,
    value,
)
from studies.command.session import held_out


# fmt: off
@click.command()
@cell_argument
@data_argument
@value("--plan plan_path", "PLAN", "The plan that is being measured. Poses of DATA are recognised.")
@value("--goal-mm", "X", "Goal: expected RMS error at the targets.", Finite(min=0, min_open=True))
@value("--holdout holdout_path", "FILE", "Measured poses that take no part in the fit, for a check.")
@result_options(figures=False)
def enough(
    cell_path: Path, data_path: Path, plan_path: Path | None, goal_mm: float | None,
    holdout_path: Path | None, json_path: str | None, seed: int,
) -> None:
    """Say whether the measured poses are enough, and in which order to measure the rest.

    CELL describes the measurement cell (cell.toml). DATA is the table of points measured so far. The
    command states the expected accuracy now, and after each further pose of the plan. It says at which
    pose the goal is reached.

    Held-out poses must also meet the goal. Without them, the first third of the readings is predicted
    from the others, and so is the last third.

    \b
    Example:
      posecal enough cell.toml day.csv --plan plan.csv --holdout check.csv
    """
    import calib
    import doe
    from studies.results.base import envelope
    from studies.results.enough import EnoughResult

    cell = calib.load_cell(cell_path)
    inputs = [cell_path, *cell.robot_files, data_path, *cell.named_files]
    inputs += [path for path in (plan_path, holdout_path) if path is not None]
    check_outputs([output_file(json_path)], inputs)
    whole = calib.load_measurements(cell, data_path)
    holdout = None if holdout_path is None else str(holdout_path.resolve())  # never a share
    data, heldout, _, warnings = held_out(cell, whole, holdout, seed, data_path)
    plan = None if plan_path is None else calib.load_plan(cell, plan_path)
    goal = None if goal_mm is None else goal_mm * 1e-3
    with faults_in(cell_path, readings_of=data_path), working("judging what was measured"):
        answer = doe.enough(cell, data, plan, heldout=heldout, goal=goal, seed=seed)
    planned, made_from = 0 if plan is None else len(plan), envelope(cell.name, inputs, seed)
    result = EnoughResult.of(answer, cell, made_from, planned=planned, warnings=warnings)
    deliver(result, json_path)
