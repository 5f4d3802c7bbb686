"""``posecal enough``: whether the poses measured so far will do, and which to measure next."""

from __future__ import annotations

from pathlib import Path

import click

from studies.command import options
from studies.command.call import Call, working
from studies.command.session import read_session


# fmt: off
@click.command()
@options.cell
@options.data
@options.value("--plan plan_path", "PLAN",
               "The plan that is being measured. Poses of DATA are recognised.")
@options.value("--goal-mm", "X", "Goal: expected RMS error at the targets.", options.ABOVE_ZERO)
@options.value("--holdout holdout_path", "FILE",
               "Measured poses that take no part in the fit, for a check.")
@options.result(figures=False)
def enough(
    call: Call, cell_path: Path, data_path: Path, plan_path: Path | None, goal_mm: float | None,
    holdout_path: Path | None,
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
    from studies.results.enough import EnoughResult

    cell = calib.load_cell(cell_path)
    inputs = [cell_path, *cell.robot_files, data_path, *cell.named_files]
    inputs += [path for path in (plan_path, holdout_path) if path is not None]
    call.check(inputs)
    day = read_session(cell, data_path, holdout_path, call.seed)
    plan = None if plan_path is None else calib.load_plan(cell, plan_path)
    goal = None if goal_mm is None else goal_mm * 1e-3
    with (
        options.faults_in(cell_path, readings_of=data_path),
        working("judging what was measured"),
    ):
        answer = doe.enough(cell, day.data, plan, heldout=day.heldout, goal=goal)
    call.deliver(EnoughResult.of(
        answer, cell, call.envelope(cell, inputs),
        planned=0 if plan is None else len(plan), warnings=day.warnings,
    ))
