"""``posecal identify``: parameters of the model from measured points."""

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
    result_options,
)
from studies.command.session import read_session

if TYPE_CHECKING:
    from calib.identification.fit import Method
    from calib.observations import Approach, Weighting


@click.command()
@cell_argument
@data_argument
@click.option(
    "--holdout",
    metavar="FILE|FRACTION",
    help="Held-out poses: a table, or a share of the configurations.",
)
@click.option(
    "--approach",
    type=click.Choice(["points", "pose"]),
    default="points",
    show_default=True,
    help="Method: use the marker points, or the full pose computed from them.",
)
@click.option(
    "--method",
    type=click.Choice(["joint", "two-step"]),
    default="joint",
    show_default=True,
    help="Solver: all parameters together, or base and tool in turn with the rest.",
)
@click.option(
    "--weighting",
    type=click.Choice(["full", "normalised", "plain"]),
    default="full",
    show_default=True,
    help="For the full-pose method: full covariance, one standard deviation for each component, or "
    "one length for the rotations.",
)
@click.option(
    "--length-mm",
    metavar="MM",
    type=Finite(min=1e-3, max=1e6),
    default=1000.0,
    show_default=True,
    help="Length that converts rotations to mm in the plain weighting.",
)
@click.option(
    "--urdf",
    "urdf_path",
    metavar="OUT",
    type=PATH,
    help="Write the robot with the identified geometry and the markers as URDF.",
)
@click.option("--zero-offsets", "zeros_path", metavar="OUT", type=PATH,
              help="Write joint offsets alone, for a controller that accepts only these.")  # fmt: skip
@click.option(
    "--counts-per-deg",
    metavar="J1=N,..",
    default=None,
    help="Encoder counts per degree, for FANUC's $MASTER_COUN in --zero-offsets.",
)
@result_options()
def identify(
    cell_path: Path,
    data_path: Path,
    holdout: str | None,
    approach: Approach,
    method: Method,
    weighting: Weighting,
    length_mm: float,
    urdf_path: Path | None,
    zeros_path: Path | None,
    counts_per_deg: str | None,
    folder: Path | None,
    json_path: str | None,
    seed: int,
) -> None:
    """Identify the effects in the cell's [model] from measured points.

    CELL describes the measurement cell (cell.toml). DATA is the table of measured points
    (measurements.csv), one row for each point.

    \b
    Example:
      posecal identify cell.toml measurements.csv --holdout 0.3 --json result.json
    """
    import calib
    from studies.identify.make import MOST, SECONDS, identified, inputs_of
    from studies.identify.robots import counts_of, offsets_file, robot_texts

    cell = calib.load_cell(cell_path)
    with working(f"reading {data_path.name}"):
        session = read_session(cell, data_path, holdout, seed)
    counts = counts_of(counts_per_deg)
    written = [urdf_path, zeros_path, output_file(json_path)]
    check_outputs(written, inputs_of(session), folder)
    count = min(len(session.whole), MOST)
    with working(f"identifying {count} readings", SECONDS * count):
        found, record = identified(
            session, approach=approach, method=method, weighting=weighting, length_mm=length_mm,
        )  # fmt: skip
    files, left_out = robot_texts(cell, found, urdf_path)
    if zeros_path is not None:
        files[zeros_path], lost = offsets_file(cell, found, zeros_path, counts)
        left_out += lost
    deliver(record, json_path, folder, files)
    for line in left_out:
        click.echo(line, err=json_path == "-")
