"""``posecal identify``: parameters of the model from measured points."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import click

from studies.command.deliver import (
    check_outputs,
    figure_files,
    output_file,
    say_written,
    show,
    warn,
)
from studies.command.options import (
    PATH,
    Finite,
    cell_argument,
    data_argument,
    faults_in,
    result_options,
)
from studies.commands.common import envelope, output_texts

if TYPE_CHECKING:
    from calib import Cell, Identification, Measurements
    from calib.arm.dh import Convention
    from calib.cell import Form
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
    help="Of approach pose: propagated covariance, each component by its own standard deviation, or "
    "one length for the rotations.",
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
@click.option(
    "--mjcf",
    "mjcf_path",
    metavar="OUT",
    type=PATH,
    help="The same as MJCF, the form of MuJoCo.",
)
@click.option("--dh", "dh_path", metavar="OUT", type=PATH,
              help="The same as DH table, with what that cannot hold.")  # fmt: skip
@click.option("--dh-convention", type=click.Choice(["classic", "modified"]), default=None,
              help="Of --dh. Default: the cell's own, else classic.")  # fmt: skip
@click.option("--kinematics", "kinematics_path", metavar="OUT", type=PATH,
              help="The same as the maker's YAML: Universal Robots, Franka.")  # fmt: skip
@click.option("--zero-offsets", "zeros_path", metavar="OUT", type=PATH,
              help="Joint offsets alone, for a controller that takes nothing else.")  # fmt: skip
@click.option("--counts-per-deg", metavar="J1=N,..", default=None,
              help="Encoder counts a degree, for FANUC's $MASTER_COUN in --zero-offsets.")  # fmt: skip
@result_options
def identify(
    cell_path: Path,
    data_path: Path,
    holdout: str | None,
    approach: str,
    method: str,
    weighting: str,
    length_mm: float,
    differences: bool,
    urdf_path: Path | None,
    mjcf_path: Path | None,
    dh_path: Path | None,
    dh_convention: str | None,
    kinematics_path: Path | None,
    zeros_path: Path | None,
    counts_per_deg: str | None,
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
    from calib.files.estimate import estimate_fields
    from calib.files.results import identification_fields
    from calib.files.write import write_files
    from studies.identify.drift_table import drift_tables
    from studies.identify.robots import counts_of, offsets_file, robot_texts
    from studies.identify.tables import identification_tables

    cell = calib.load_cell(cell_path)
    targets = cell.design["targets"]
    data = calib.load_measurements(cell, data_path)
    inputs = [cell_path, *cell.robot_files, data_path, *([targets] if targets else [])]
    whole = data
    data, heldout, extra = held_out(cell, data, holdout, seed, data_path)
    robots: dict[Form, Path | None] = {
        "urdf": urdf_path,
        "mjcf": mjcf_path,
        "dh": dh_path,
        "kinematics": kinematics_path,
    }
    counts = counts_of(counts_per_deg)
    outputs = [*robots.values(), zeros_path, output_file(json_path)]
    check_outputs(outputs, [*inputs, *extra], folder)
    table_warnings = data.warnings + (heldout.warnings if heldout is not None and extra else ())
    warn(table_warnings)
    with faults_in(data_path, effects_of=cell_path):
        result = calib.identify(
            cell,
            data,
            heldout=heldout,
            approach=cast("Approach", approach),
            method=cast("Method", method),
            weighting=cast("Weighting", weighting),
            length=length_mm / 1e3,
            differences=differences,
        )
    fields = {
        **envelope("identify", [*inputs, *extra], seed),
        "warnings": [*table_warnings, *result.warnings],
        "weighting": weighting if approach == "pose" else None,
        "length_mm": length_mm if approach == "pose" and weighting == "plain" else None,
        "differences": differences,
        "holdout": holdout,
        **identification_fields(result),
        **_expected_accuracy(cell, result),
        "drift": _drift(cell, whole, result),
        "estimate": estimate_fields(estimate_of(result)),
    }
    warn(result.warnings)
    texts: dict[Path, str | bytes] = {**output_texts(json_path, fields)}
    made, left_out = robot_texts(cell, result, robots, cast("Convention | None", dh_convention))
    texts |= made
    if zeros_path is not None:
        texts[zeros_path], lost = offsets_file(cell, result, zeros_path, counts)
        left_out += lost
    if folder is not None:
        from studies.identify.pictures import pictures

        texts |= figure_files(pictures(fields), folder)
    write_files(texts)
    show(identification_tables(cell, result, fields), json_path)
    show(drift_tables(result.model, fields["drift"]), json_path)
    say_written(texts, folder, json_path)
    for line in left_out:
        click.echo(line, err=json_path == "-")


def held_out(
    cell: Cell, data: Measurements, holdout: str | None, seed: int, data_path: Path
) -> tuple[Measurements, Measurements | None, list[Path]]:
    """(fitted, held out, further input files)."""
    import numpy as np

    import calib
    from calib.errors import InputError

    if holdout is None:
        return data, None, []
    path = Path(holdout)
    try:
        fraction = float(holdout)
    except ValueError:
        if path.resolve() == data_path.resolve():
            raise InputError(path, "", "holds the data themselves", "name other poses") from None
        held = calib.load_measurements(cell, path, every_marker=False)
        warn(shared_points(data, held))
        return *calib.in_one_session(data, held), [path]
    if not 0.0 < fraction < 1.0:
        raise InputError("--holdout", "", f"{holdout} is not between 0 and 1", "use 0.3, or a file")
    kept, held = data.split(fraction, np.random.default_rng(seed))
    return kept, held, []


def shared_points(data: Measurements, held: Measurements) -> tuple[str, ...]:
    """A warning for held-out poses that are among the fitted ones: noise never repeats to the digit."""
    fitted = {point.tobytes() for point in data.points[data.seen]}
    names = [
        name
        for name, points, seen in zip(held.poses.names, held.points, held.seen, strict=True)
        if seen.any() and all(point.tobytes() in fitted for point in points[seen])
    ]
    if not names:
        return ()
    return (f"{len(names)} of the held-out poses are in the data too ({names[0]} ..): no proof",)


def _expected_accuracy(cell: Cell, result: Identification) -> dict[str, Any]:
    """What the parameters' uncertainty leaves at the target poses."""
    from calib.files.results import at_targets
    from calib.model.covariance import errors_at, task_error
    from calib.targets import targets_of

    targets, weights = targets_of(cell)
    errors = errors_at(result.model, result.values, result.knowledge, targets)
    rms, worst = task_error(errors, weights)
    own = cell.design.get("targets")
    return {
        "task_rms_mm": rms * 1e3,
        "task_worst_mm": worst * 1e3,
        "targets": str(own) if own is not None else f"{len(targets)} Sobol poses within the limits",
        "at_targets": at_targets(cell.robot, targets, errors),
    }


def _drift(cell: Cell, whole: Measurements, result: Identification) -> dict[str, Any] | None:
    """What the repeated readings say, held-out ones included; the fit only places the instrument."""
    from calib.drift import drift_of
    from calib.files.drift import drift_fields
    from calib.identification.identify import whitening

    return drift_fields(drift_of(whole, whitening(cell, result.model, result.values, whole)))
