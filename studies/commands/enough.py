"""``posecal enough``: whether the poses measured so far will do, and which to measure next."""

from __future__ import annotations

from pathlib import Path

import click

from studies.commands.common import (
    PATH,
    Finite,
    cell_argument,
    check_outputs,
    data_argument,
    envelope,
    faults_in,
    json_option,
    one_line_faults,
    output_file,
    output_texts,
    say_written,
    seed_option,
    show,
    warn,
)


@click.command(short_help="Half-way: are the poses enough, which come next?")
@cell_argument
@data_argument
@click.option("--plan", "plan_path", metavar="PLAN", type=PATH,
              help="The plan that is being measured; what DATA hold of it is recognised.")  # fmt: skip
@click.option(
    "--goal-mm",
    metavar="X",
    type=Finite(min=0, min_open=True),
    help="Expected RMS error at the targets that is wanted.",
)
@json_option
@seed_option
@one_line_faults
def enough(
    cell_path: Path,
    data_path: Path,
    plan_path: Path | None,
    goal_mm: float | None,
    json_path: str | None,
    seed: int,
) -> None:
    """Say whether the poses measured so far are enough, and in which order to measure the rest.

    CELL is the description of the measurement cell (cell.toml), DATA the table of points measured so
    far. With the noise that the data show, it says what accuracy to expect now, after each further pose
    of the plan in the best order, and after how many the goal is met.

    \b
    Example:
      posecal enough cell.toml measurements.csv --plan plan.csv --goal-mm 0.05
    """
    import calib
    from calib.files.write import write_files
    from doe.prospect.sufficiency.enough import enough as judge
    from doe.prospect.sufficiency.results import enough_fields
    from studies.enough.tables import enough_tables

    cell = calib.load_cell(cell_path)
    targets = cell.design.get("targets")
    inputs = [cell_path, *cell.robot_files, data_path, *([targets] if targets else [])]
    inputs += [plan_path] if plan_path is not None else []
    check_outputs([output_file(json_path)], inputs)
    data = calib.load_measurements(cell, data_path)
    plan = None if plan_path is None else calib.load_plan(cell, plan_path)
    with faults_in(cell_path, readings_of=data_path):
        goal = None if goal_mm is None else goal_mm / 1e3
        answer = judge(cell, data, plan, goal=goal, seed=seed)
    fields = {
        **envelope("enough", inputs, seed),
        "targets": str(targets or "200 Sobol poses within the limits"),
        **enough_fields(answer, 0 if plan is None else len(plan)),
    }
    warn((*data.warnings, *answer.match.warnings))
    texts: dict[Path, str | bytes] = {**output_texts(json_path, fields)}
    write_files(texts)
    show(enough_tables(fields), json_path)
    say_written(texts, None, json_path)
