"""``posecal diagnose``: where the gap lies, what causes it, how far it shrinks."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from studies.command.deliver import (
    check_outputs,
    figure_files,
    output_file,
    say_written,
    show,
    warn,
)
from studies.command.options import PATH, cell_argument, data_argument, faults_in, result_options
from studies.commands.common import envelope, output_texts

if TYPE_CHECKING:
    from calib import Cell


@click.command(short_help="What the model lacks: where, why, how much.")
@cell_argument
@data_argument
@click.option(
    "--holdout",
    metavar="FILE|FRACTION",
    help="Poses on which the shrinkage is proved: a table, or a share of the configurations.",
)
@click.option(
    "--plan-only",
    is_flag=True,
    help="DATA is a plan: say what could be found at its poses, before anything is measured.",
)
@click.option(
    "--cell-out",
    "cell_out",
    metavar="FILE",
    type=PATH,
    help="Write the cell with the found effects in its model: the next run starts from there.",
)
@click.option(
    "--next",
    "next_count",
    metavar="N",
    type=click.IntRange(min=0, max=1000),
    default=8,
    show_default=True,
    help="Poses to choose that tell rival causes apart; 0 for none.",
)
@result_options
def diagnose(
    cell_path: Path,
    data_path: Path,
    holdout: str | None,
    plan_only: bool,
    cell_out: Path | None,
    folder: Path | None,
    next_count: int,
    json_path: str | None,
    seed: int,
) -> None:
    """Say whether measurements show more than the cell's model and noise, where, and why.

    Every effect that the model lacks is asked at every place where it can act, beside curves without a
    name that locate what is in no catalogue.

    \b
    Example:
      posecal diagnose cell.toml measurements.csv --holdout 0.3 --json diagnosis.json
      posecal diagnose cell.toml plan.csv --plan-only
    """
    import calib
    from calib.compensation.estimate import estimate_of
    from calib.diagnosis.diagnose import diagnose as diagnose_data
    from calib.diagnosis.spectra import spectra
    from calib.errors import CalibError, InputError
    from calib.files.diagnosis import diagnosis_fields
    from calib.files.write import write_files
    from doe.prospect.rivals.next_poses import next_poses
    from doe.prospect.rivals.results import next_fields
    from studies.command.holdout import held_out
    from studies.diagnose.next_tables import next_tables
    from studies.diagnose.shown import shown_fields
    from studies.diagnose.tables import diagnosis_tables
    from studies.estimate import estimated

    cell = calib.load_cell(cell_path)
    if plan_only:
        for name, value in (("--holdout", holdout), ("--cell-out", cell_out)):
            if value is not None:
                raise InputError(name, "", "does not go with --plan-only", "give one of them")
        _foresee(cell, cell_path, data_path, folder, json_path, seed)
        return
    data = calib.load_measurements(cell, data_path)
    inputs = [cell_path, *cell.robot_files, data_path]
    data, heldout, extra, warnings = held_out(cell, data, holdout, seed, data_path)
    targets = cell.design["targets"]
    outputs = [output_file(json_path), cell_out]
    check_outputs(outputs, [*inputs, *extra, *([targets] if targets else [])], folder)
    warn(warnings)
    with faults_in(data_path, effects_of=cell_path):
        result = diagnose_data(cell, data, heldout=heldout)
    fields = {
        **envelope("diagnose", [*inputs, *extra], seed),
        "holdout": holdout,
        **diagnosis_fields(result, spectra(result)),
        "estimate": estimated(estimate_of(result)).model_dump(by_alias=True),
    }
    if next_count:
        try:
            chosen = next_poses(cell, result, count=next_count, seed=seed)
            fields |= next_fields(chosen, cell.robot)
        except CalibError as error:  # the diagnosis stands without them
            warn((f"no next poses: {error}",))
    if json_path is not None or folder is not None:
        fields |= shown_fields(result)
    texts: dict[Path, str | bytes] = {**output_texts(json_path, fields)}
    notes: list[str] = []
    if cell_out is not None:
        from studies.diagnose.cell_out import better_cell

        texts[cell_out], notes = better_cell(cell, result, cell_out)
    if folder is not None:
        from studies.diagnose.pictures import pictures

        texts |= figure_files(pictures(fields), folder)
    write_files(texts)
    show((*diagnosis_tables(cell.name, fields), *next_tables(fields), *notes), json_path)
    say_written(texts, folder, json_path)


def _foresee(
    cell: Cell,
    cell_path: Path,
    plan_path: Path,
    folder: Path | None,
    json_path: str | None,
    seed: int,
) -> None:
    """What a plan, or the readings of a table without their points, could show."""
    import calib
    from calib.files.tables import holds_points
    from calib.files.write import write_files
    from doe.prospect.fields import power_fields
    from doe.prospect.foresee import foresee
    from studies.diagnose.plan_tables import foresight_tables

    inputs = [cell_path, *cell.robot_files, plan_path]
    check_outputs([output_file(json_path)], inputs, folder)
    load = calib.load_measurements if holds_points(plan_path) else calib.load_plan
    plan = load(cell, plan_path)
    with faults_in(plan_path, effects_of=cell_path):
        found = foresee(cell, plan)
    fields = {**envelope("diagnose", inputs, seed), **power_fields(found)}
    texts: dict[Path, str | bytes] = {**output_texts(json_path, fields)}
    if folder is not None:
        from studies.diagnose.plan_pictures import pictures

        texts |= figure_files(pictures(found), folder)
    write_files(texts)
    show(foresight_tables(cell.name, cell.robot.joints, fields), json_path)
    say_written(texts, folder, json_path)
