"""``posecal import``: points of an instrument and joints of a controller, joined into one table."""

from __future__ import annotations

from pathlib import Path

import click

from studies.command.deliver import check_outputs, deliver, output_file
from studies.command.options import PATH, result_options


@click.command("import")
@click.argument("points", metavar="POINTS", type=PATH)
@click.option("--joints", "joints_path", metavar="FILE", required=True, type=PATH,
              help="Table of the joints of each pose: pose,A1_deg,..")  # fmt: skip
@click.option("-o", "--output", "table_path", metavar="TABLE", required=True,
              type=PATH, help="Write the joined table to this file.")  # fmt: skip
@click.option("--cell", "cell_path", metavar="CELL", type=PATH,
              help="Check the joined table against this cell.")  # fmt: skip
@result_options(figures=False, seed=False)
def import_(
    points: Path, joints_path: Path, table_path: Path, cell_path: Path | None, json_path: str | None
) -> None:
    """Join a table of measured points with a table of the joints of their poses.

    POINTS is a CSV with the columns pose, marker and x_mm, y_mm, z_mm (or what else an instrument
    reads). The poses must have the same names in both files.

    The order of the joint file is taken as the order of measurement.

    \b
    Example:
      posecal import points.csv --joints joints.csv -o measurements.csv
    """
    import calib
    from calib.files.csv_table import csv_text
    from studies.imports.record import import_record, joined, read_back
    from studies.record import envelope

    cell = None if cell_path is None else calib.load_cell(cell_path)
    inputs = [points, joints_path, *([] if cell is None else [cell.path, *cell.robot_files])]
    check_outputs([table_path, output_file(json_path)], inputs)
    table, mine = joined(points, joints_path)
    text = csv_text(table.columns, table.rows)
    warnings = () if cell is None else read_back(cell, text, table_path)
    made_from = envelope("" if cell is None else cell.name, inputs)
    deliver(import_record(table, mine, warnings, made_from), json_path, files={table_path: text})
