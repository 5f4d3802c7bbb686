"""``posecal iso9283``: accuracy and repeatability as the standard has them."""

from __future__ import annotations

from pathlib import Path

import click

from studies.command.deliver import check_outputs, deliver, output_file, working
from studies.command.options import (
    PATH,
    cell_argument,
    data_argument,
    faults_in,
    result_options,
)


@click.command()
@cell_argument
@data_argument
@click.argument("result_path", metavar="[RESULT]", type=PATH, required=False)
@click.option(
    "--marker", metavar="NAME", help="The marker to judge. Default: the first that was measured."
)
@result_options(seed=False)
def iso9283(
    cell_path: Path,
    data_path: Path,
    result_path: Path | None,
    marker: str | None,
    folder: Path | None,
    json_path: str | None,
) -> None:
    """State the criteria of ISO 9283: AP, RP, AD, RD, vAP, drift and static compliance.

    DATA is a table with repeat visits of the same poses. RESULT is the JSON of identify on other
    poses; it gives the base position. Without RESULT, base and markers are fitted to DATA itself,
    and AP is too small. Criteria that were not measured are predicted, with intervals.

    \b
    Example:
      posecal identify cell.toml measurements.csv --json result.json
      posecal iso9283 cell.toml cycles.csv result.json
    """
    import calib
    from studies.iso9283.record import criteria
    from studies.record import envelope

    cell = calib.load_cell(cell_path)
    data = calib.load_measurements(cell, data_path)
    results = [] if result_path is None else [result_path]
    inputs = [cell_path, *cell.robot_files, data_path, *results]
    check_outputs([output_file(json_path)], inputs, folder)
    with faults_in(data_path, effects_of=cell.path), working("predicting the criteria"):
        record = criteria(
            cell,
            data,
            data_path,
            result_path,
            marker,
            envelope(cell.name, inputs, about=cell.about),
        )
    deliver(record, json_path, folder)
