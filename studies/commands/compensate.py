"""``posecal compensate``: joint commands that bring the real arm to nominal targets."""

from __future__ import annotations

from pathlib import Path

import click

from studies.commands.common import (
    PATH,
    cell_argument,
    check_outputs,
    envelope,
    faults_in,
    json_option,
    one_line_faults,
    output_file,
    output_texts,
    say_written,
    show,
    warn,
)


@click.command(short_help="Commands that bring the real arm to its targets.")
@cell_argument
@click.argument("result_path", metavar="RESULT", type=PATH)
@click.argument("targets_path", metavar="TARGETS", type=PATH)
@click.option(
    "-o",
    "--output",
    "plan_path",
    metavar="FILE",
    type=PATH,
    help="Write the targets' table with corrected joints; it reads back as a plan.",
)
@json_option
@one_line_faults
def compensate(
    cell_path: Path,
    result_path: Path,
    targets_path: Path,
    plan_path: Path | None,
    json_path: str | None,
) -> None:
    """Correct joint commands so that the real arm stands where the nominal one should.

    RESULT is the JSON of identify or diagnose, TARGETS a table of nominal joint commands, with the
    wrench at each where it bears one (else the cell's [load] hangs there). Geometry, load and whatever
    else was identified are corrected together, and the error expected to remain is stated.

    \b
    Example:
      posecal identify cell.toml measurements.csv --json result.json
      posecal compensate cell.toml result.json targets.csv -o corrected.csv
    """
    import calib
    from calib.errors import InputError
    from calib.files.compensation import compensated_csv, nominal_table
    from calib.files.estimate import load_estimate
    from calib.files.write import write_files
    from studies.compensate.results import compensation_fields
    from studies.compensate.tables import compensation_tables

    cell = calib.load_cell(cell_path)
    inputs = [cell_path, *cell.robot_files, result_path, targets_path]
    check_outputs([plan_path, output_file(json_path)], inputs)
    table = nominal_table(cell, targets_path)
    estimate = load_estimate(cell, result_path)
    if not estimate.converged:
        raise InputError(result_path, "", "did not converge", "mend the identification first")
    targets, weights = calib.load_targets(cell, targets_path)
    with faults_in(targets_path):
        found = calib.compensate(cell, estimate, targets, weights=weights)
    fields = {**envelope("compensate", inputs, 0), **compensation_fields(cell.robot, found)}
    warn(found.notes)
    texts: dict[Path, str | bytes] = {**output_texts(json_path, fields)}
    if plan_path is not None:
        texts[plan_path] = compensated_csv(cell, table, found)
    write_files(texts)
    show(compensation_tables(cell.name, fields), json_path)
    say_written(texts, None, json_path)
