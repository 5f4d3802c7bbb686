"""``posecal identify``: parameters of the model from measured points."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from studies.command.deliver import check_outputs, deliver, output_file
from studies.command.holdout import held_out
from studies.command.options import (
    PATH,
    Finite,
    cell_argument,
    data_argument,
    faults_in,
    result_options,
)

if TYPE_CHECKING:
    from calib.files.robot_out import Form
    from calib.identification.identification import Method
    from calib.observations import Approach, Weighting


@click.command(short_help="The model's parameters from measured points.")
@cell_argument
@data_argument
@click.option(
    "--holdout",
    metavar="FILE|FRACTION",
    help="Poses that take no part and are predicted: a table, or a share of the configurations.",
)
@click.option(
    "--approach",
    type=click.Choice(["points", "pose"]),
    default="points",
    show_default=True,
    help="Marker points directly, or the full pose computed from them.",
)
@click.option(
    "--method",
    type=click.Choice(["joint", "two-step"]),
    default="joint",
    show_default=True,
    help="All parameters at once, or base and tool in turn with the rest.",
)
@click.option(
    "--weighting",
    type=click.Choice(["full", "normalised", "plain"]),
    default="full",
    show_default=True,
    help="Of approach pose: propagated covariance, each component by its own standard "
    "deviation, or one length for the rotations.",
)
@click.option(
    "--length-mm",
    type=Finite(min=1e-3, max=1e6),
    default=1000.0,
    show_default=True,
    help="Characteristic length of the plain weighting.",
)
@click.option(
    "--differences",
    is_flag=True,
    help="Elastic parameters from loaded minus free readings at equal joints.",
)
@click.option(
    "--urdf",
    "urdf_path",
    metavar="OUT",
    type=PATH,
    help="Write the robot with the identified geometry and the markers as URDF.",
)
@click.option("--mjcf", "mjcf_path", metavar="OUT", type=PATH,
              help="The same as MJCF, the form of MuJoCo.")  # fmt: skip
@result_options
def identify(
    cell_path: Path,
    data_path: Path,
    holdout: str | None,
    approach: Approach,
    method: Method,
    weighting: Weighting,
    length_mm: float,
    differences: bool,
    urdf_path: Path | None,
    mjcf_path: Path | None,
    folder: Path | None,
    json_path: str | None,
    seed: int,
) -> None:
    """Identify the effects in the cell's [model] from measured points.

    CELL is the description of the measurement cell (cell.toml), DATA the table of measured points
    (measurements.csv), one row a point.

    \b
    Example:
      posecal identify cell.toml measurements.csv --holdout 0.3 --json result.json
    """
    import calib
    from calib.compensation.estimate import estimate_of
    from calib.drift import drift_of
    from calib.files.robot_out import corrected_robots, left_out
    from calib.identification.identify import whitening
    from calib.targets import accuracy_at_targets
    from studies.identify.record import Asked, identify_record
    from studies.record import envelope

    cell = calib.load_cell(cell_path)
    targets = cell.design["targets"]
    whole = calib.load_measurements(cell, data_path)
    data, heldout, further, warnings = held_out(cell, whole, holdout, seed, data_path)
    inputs = [cell_path, *cell.robot_files, data_path, *([targets] if targets else []), *further]
    robots: dict[Form, Path | None] = {"urdf": urdf_path, "mjcf": mjcf_path}
    check_outputs([*robots.values(), output_file(json_path)], inputs, folder)
    with faults_in(data_path, effects_of=cell_path):
        found = calib.identify(
            cell, data, heldout=heldout, approach=approach, method=method, weighting=weighting,
            length=length_mm * 1e-3, differences=differences,
        )  # fmt: skip
    of_pose = approach == "pose"
    asked = Asked(
        weighting=weighting if of_pose else None,
        length_mm=length_mm if of_pose and weighting == "plain" else None,
        differences=differences,
        holdout=holdout,
    )
    record = identify_record(
        found,
        accuracy_at_targets(cell, found),
        drift_of(whole, whitening(cell, found.model, found.values, whole)),
        estimate_of(found),
        asked,
        envelope(cell.name, inputs, seed),
        warnings,
    )
    files = corrected_robots(cell, found, robots)
    deliver(record, json_path, folder, files)
    for line in left_out(cell, found.model, robots):
        click.echo(line, err=json_path == "-")
