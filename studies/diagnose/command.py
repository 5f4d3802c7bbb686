"""``posecal diagnose``: where the gap lies, what causes it, how far it shrinks."""

from __future__ import annotations

from pathlib import Path

import click

from studies.command.deliver import check_outputs, deliver, output_file, show, working
from studies.command.options import PATH, cell_argument, data_argument, result_options
from studies.command.session import read_session


@click.command()
@cell_argument
@data_argument
@click.option(
    "--holdout",
    metavar="FILE|FRACTION",
    help="Held-out poses that show the error before and after: a table, or a share of the "
    "configurations.",
)
@click.option(
    "--plan-only",
    is_flag=True,
    help="DATA is a plan. Say what its poses can detect, before you measure.",
)
@click.option(
    "--cell-out",
    "cell_out",
    metavar="FILE",
    type=PATH,
    help="Write the cell with the found effects in its model, for the next run.",
)
@result_options()
def diagnose(
    cell_path: Path,
    data_path: Path,
    holdout: str | None,
    plan_only: bool,
    cell_out: Path | None,
    folder: Path | None,
    json_path: str | None,
    seed: int,
) -> None:
    """Find the causes of the error that the cell's model and the noise do not explain.

    The command tries every effect that the model lacks, at every place where it can act. It also tries
    free curves. They locate errors whose cause is not in the catalogue.

    \b
    Example:
      posecal diagnose cell.toml day.csv --holdout 0.3 --json diagnosis.json
      posecal diagnose cell.toml plan.csv --plan-only
    """
    import calib
    from calib.errors import InputError
    from studies.command.plan import foresee_plan
    from studies.diagnose.make import SECONDS, better_cell, diagnosed, inputs_of

    cell = calib.load_cell(cell_path)
    if plan_only:
        for name, value in (
            ("--holdout", holdout),
            ("--cell-out", cell_out),
            ("--figures", folder),
        ):
            if value is not None:
                raise InputError(name, "", "does not go with --plan-only", "give one of them")
        foresee_plan(cell, data_path, json_path, seed)
        return
    with working(f"reading {data_path.name}"):
        session = read_session(cell, data_path, holdout, seed)
    outputs = [output_file(json_path), cell_out]
    check_outputs(outputs, [*inputs_of(session), *session.named], folder)
    figures = json_path is not None or folder is not None
    count = len(session.held.data)
    with working(f"diagnosing {count} readings", SECONDS * count):
        found, record = diagnosed(session, figures=figures)
    texts: dict[Path, str | bytes] = {}
    notes: list[str] = []
    if cell_out is not None:
        texts[cell_out], notes = better_cell(cell, found, cell_out)
    deliver(record, json_path, folder, texts)
    show(notes, json_path)
