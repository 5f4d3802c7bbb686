"""``posecal diagnose``: where the gap lies, what causes it, how far it shrinks."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from studies.command.deliver import check_outputs, deliver, output_file, show
from studies.command.options import PATH, cell_argument, data_argument, faults_in, result_options

if TYPE_CHECKING:
    from calib import Cell
    from calib.diagnosis import Diagnosis
    from doe.prospect.rivals.next_poses import NextPoses


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
    from calib.diagnosis.diagnose import diagnose as diagnose_data
    from calib.diagnosis.spectra import spectra
    from calib.errors import InputError
    from studies.command.holdout import held_out
    from studies.diagnose.cell_out import better_cell
    from studies.diagnose.record import diagnose_record
    from studies.diagnose.shown import shown
    from studies.record import envelope

    cell = calib.load_cell(cell_path)
    if plan_only:
        for name, value in (("--holdout", holdout), ("--cell-out", cell_out)):
            if value is not None:
                raise InputError(name, "", "does not go with --plan-only", "give one of them")
        _foresee(cell, data_path, folder, json_path, seed)
        return
    data = calib.load_measurements(cell, data_path)
    data, heldout, extra, warnings = held_out(cell, data, holdout, seed, data_path)
    inputs, targets = [cell_path, *cell.robot_files, data_path, *extra], cell.design["targets"]
    outputs = [output_file(json_path), cell_out]
    check_outputs(outputs, [*inputs, *([targets] if targets else [])], folder)
    with faults_in(data_path, effects_of=cell_path):
        found = diagnose_data(cell, data, heldout=heldout)
    chosen, failed = _next(cell, found, next_count, seed)
    for_figures = shown(found) if json_path is not None or folder is not None else None
    record = diagnose_record(
        found,
        spectra(found),
        chosen,
        for_figures,
        holdout,
        envelope(cell.name, inputs, seed),
        (*warnings, *failed),
    )
    texts: dict[Path, str | bytes] = {}
    notes: list[str] = []
    if cell_out is not None:
        texts[cell_out], notes = better_cell(cell, found, cell_out)
    deliver(record, json_path, folder, texts)
    show(notes, json_path)


def _next(
    cell: Cell, found: Diagnosis, count: int, seed: int
) -> tuple[NextPoses | None, tuple[str, ...]]:
    """Poses that tell rivals apart, and why there are none: the diagnosis stands without them."""
    from calib.errors import CalibError
    from doe.prospect.rivals.next_poses import next_poses

    try:
        return (next_poses(cell, found, count=count, seed=seed) if count else None), ()
    except CalibError as error:
        return None, (f"no next poses: {error}",)


def _foresee(
    cell: Cell, plan_path: Path, folder: Path | None, json_path: str | None, seed: int
) -> None:
    """What a plan, or the readings of a table without their points, could show."""
    import calib
    from calib.files.tables import holds_points
    from doe.prospect.foresee import foresee
    from studies.plan.record import plan_record
    from studies.record import envelope

    inputs = [cell.path, *cell.robot_files, plan_path]
    check_outputs([output_file(json_path)], inputs, folder)
    load = calib.load_measurements if holds_points(plan_path) else calib.load_plan
    plan = load(cell, plan_path)
    with faults_in(plan_path, effects_of=cell.path):
        found = foresee(cell, plan)
    deliver(plan_record(found, envelope(cell.name, inputs, seed)), json_path, folder)
