"""``posecal next``: the next best poses after what was measured, in a loop with the robot."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from studies.command.deliver import check_outputs, deliver, output_file, working
from studies.command.options import (
    PATH,
    Finite,
    cell_argument,
    data_argument,
    faults_in,
    result_options,
)

if TYPE_CHECKING:
    from doe.ahead.onward import Aim


@click.command("next")
@cell_argument
@data_argument
@click.option(
    "--for",
    "aim",
    type=click.Choice(["task", "causes", "both"]),
    default="task",
    show_default=True,
    help="What the poses serve: accuracy at the targets, separating causes, or both.",
)
@click.option("--poses", "count", metavar="N", type=click.IntRange(min=1, max=100), default=3,
              show_default=True, help="Number of poses to propose.")  # fmt: skip
@click.option("--goal-mm", metavar="X", type=Finite(min=0, min_open=True),
              help="Goal: expected RMS error at the targets.")  # fmt: skip
@click.option(
    "--ahead",
    metavar="N",
    type=click.IntRange(min=0, max=1000),
    default=0,
    help="Number of poses that the day still has room for. Poses for the task are the best of these.",
)
@click.option(
    "--missed",
    "missed_path",
    metavar="PLAN",
    type=PATH,
    help="Poses that could not be measured. Poses near them are not proposed again.",
)
@click.option(
    "-o", "plan_path", metavar="PLAN", type=PATH, help="Write the proposed poses as a plan."
)
@result_options()
def next_(
    cell_path: Path,
    data_path: Path,
    aim: Aim,
    count: int,
    goal_mm: float | None,
    ahead: int,
    missed_path: Path | None,
    plan_path: Path | None,
    folder: Path | None,
    json_path: str | None,
    seed: int,
) -> None:
    """Choose the next poses after what was measured, or say that it is time to stop.

    CELL describes the measurement cell (cell.toml). DATA is the table of points measured so far.
    Measure the proposed poses, add them to DATA, and run the command again.

    For the task it stops at the goal. Without a goal it stops when more poses only average noise. For
    causes it stops when the data separate them, or when no pose can. Then -o writes nothing.

    \b
    Example:
      posecal next cell.toml measurements.csv --goal-mm 0.05 -o next.csv
    """
    import calib
    import doe
    from studies.next.record import next_record, next_table
    from studies.record import envelope

    cell = calib.load_cell(cell_path)
    inputs = [cell_path, *cell.robot_files, data_path, *cell.named_files]
    inputs += [] if missed_path is None else [missed_path]
    check_outputs([plan_path, output_file(json_path)], inputs, folder)
    data = calib.load_measurements(cell, data_path)
    missed = None if missed_path is None else calib.load_plan(cell, missed_path)
    goal = None if goal_mm is None else goal_mm * 1e-3
    with faults_in(cell_path, readings_of=data_path), working("choosing the next poses"):
        found = doe.onward(
            cell, data, aim=aim, count=count, goal=goal, ahead=ahead, missed=missed, seed=seed
        )
    count_missed = 0 if missed is None else len(missed)
    made_from = envelope(cell.name, inputs, seed)
    record = next_record(found, aim, goal, count_missed, cell, made_from)
    tables = {} if plan_path is None or found.done else {plan_path: next_table(found, cell)}
    deliver(record, json_path, folder, tables)
