"""``posecal changes``: what moved between two results of one robot."""

from __future__ import annotations

from pathlib import Path

import click

from studies.command.deliver import check_outputs, deliver, output_file, working
from studies.command.options import (
    PATH,
    Finite,
    faults_in,
    result_options,
)


@click.command()
@click.argument("before_path", metavar="BEFORE", type=PATH)
@click.argument("after_path", metavar="AFTER", type=PATH)
@click.option("--cell", "cell_path", metavar="CELL", type=PATH,
              help="The cell of AFTER. Default: the cell that AFTER names.")  # fmt: skip
@click.option("--tolerance-mm", metavar="X", type=Finite(min=0, min_open=True),
              help="Largest allowed error at any target.")  # fmt: skip
@result_options(seed=False)
def changes(
    before_path: Path,
    after_path: Path,
    cell_path: Path | None,
    tolerance_mm: float | None,
    folder: Path | None,
    json_path: str | None,
) -> None:
    """Say what moved on a robot between two results, how large the effect is, and its likely cause.

    BEFORE and AFTER are JSON results of identify. The command compares the parameters that both results
    determine. The instrument and the markers may stand elsewhere. With --tolerance-mm it says whether
    the calibration of BEFORE still holds.

    \b
    Example:
      posecal identify cell.toml may.csv --json may.json
      posecal identify cell.toml june.csv --json june.json
      posecal changes may.json june.json --tolerance-mm 0.2
    """
    from calib.change import changes as compared
    from studies.changes.days import days_of
    from studies.changes.record import changes_record
    from studies.record import envelope

    days = days_of(before_path, after_path, cell_path)
    inputs = [days.cell.path, *days.cell.robot_files, before_path, after_path]
    check_outputs([output_file(json_path)], inputs, folder)
    tolerance = None if tolerance_mm is None else tolerance_mm * 1e-3
    with faults_in(after_path), working("comparing the days"):
        found = compared(days.cell, days.before, days.after, days.estimate, tolerance)
    record = changes_record(found, days, envelope(days.cell.name, inputs))
    deliver(record, json_path, folder)
