"""``posecal diagnose``: where the gap lies, what causes it, how far it shrinks."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

from studies.command.deliver import check_outputs, deliver, output_file, working
from studies.command.options import (
    cell_argument,
    data_argument,
    faults_in,
    holdout_option,
    result_options,
    value,
)
from studies.command.session import held_out

if TYPE_CHECKING:
    from calib.diagnosis import Diagnosis
    from calib.files.cell_out import Extended

_SECONDS = 50e-3  # a reading, as studies.research.benchmarks.speeds measures


@click.command()
@cell_argument
@data_argument
@holdout_option
@click.option("--plan-only", is_flag=True, help="DATA is a plan. Say what its poses can detect.")
@value("--cell-out", "FILE", "Write the cell with the causes in its model, for the next run.")
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
    from calib.files.cell_out import extended_cell
    from calib.threads import one_blas_thread
    from studies.command.plan import foresee_plan
    from studies.results.base import envelope
    from studies.results.diagnose import DiagnoseResult

    cell = calib.load_cell(cell_path)
    if plan_only:
        options = {"--holdout": holdout, "--cell-out": cell_out, "--figures": folder}
        for name, value in options.items():
            if value is not None:
                raise InputError(name, "", "does not go with --plan-only", "give one of them")
        foresee_plan(cell, data_path, json_path, seed)
        return
    with working(f"reading {data_path.name}"):
        held = held_out(cell, calib.load_measurements(cell, data_path), holdout, seed, data_path)
    inputs = [cell.path, *cell.robot_files, data_path, *held.files]
    check_outputs([output_file(json_path), cell_out], [*inputs, *cell.named_files], folder)
    with working(f"diagnosing {len(held.data)} readings", _SECONDS * len(held.data)):
        with faults_in(data_path, effects_of=cell.path):
            found = calib.diagnose(cell, held.data, heldout=held.heldout)
        result = one_blas_thread(DiagnoseResult.of)(
            found,
            cell,
            envelope(cell.name, inputs, seed, cell.about),
            figures=json_path is not None or folder is not None,
            holdout=holdout,
            warnings=held.warnings,
        )
    texts: dict[Path, str | bytes] = {}
    notes: list[str] = []
    if cell_out is not None:
        effects = [cause.named.candidate.effect for cause in found.causes]
        made = extended_cell(cell, effects, found.data.poses, cell_out)
        texts[cell_out], notes = made.text, [f"{cell_out}: {note}" for note in _notes(made, found)]
    deliver(result, json_path, folder, texts, notes=notes)


def _notes(made: Extended, found: Diagnosis) -> Iterator[str]:
    """What the reader of a cell with the causes must know."""
    if made.added:
        yield f"model with {', '.join(made.added)}"
    else:
        yield "the model as it was; no effect was found that could be added"
    if made.replaced:
        yield f"they contain, and replace, {', '.join(made.replaced)}"
    yield from (f"without {effect}; {reason}" for effect, reason in made.refused)
    for cause in found.causes:
        first, *others = [f"{c.effect.kind}:{c.where}" for c, _ in cause.named.members]
        if others:
            alike = " or ".join(others)
            yield f"{first} stands for {alike} too, which these data cannot tell from it"
    entries = [entry.candidate for entry in found.outcome.entries if not entry.candidate.named]
    if entries:
        unnamed = ", ".join(f"{entry.where} by {entry.depends_on}" for entry in entries)
        yield f"without {unnamed}; a curve without a name is no effect"
