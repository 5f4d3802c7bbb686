"""``posecal diagnose``: where the gap lies, what causes it, how far it shrinks."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

from studies.command import options
from studies.command.call import Call, working
from studies.command.motion import Form, deliver_motions, mjcf
from studies.command.session import read_session

if TYPE_CHECKING:
    from calib import Cell
    from calib.diagnosis import Diagnosis
    from calib.files.cell_out import Extended

_SECONDS = 50e-3  # a reading, as studies.research.speed measures


# fmt: off
@click.command()
@options.cell
@options.data
@options.holdout
@click.option("--plan-only", is_flag=True, help="DATA is a plan. Say what its poses can detect.")
@options.value("--cell-out", "FILE", "Write the cell with the causes in its model, for the next run.")
@options.value("--urdf urdf_path", "OUT", "Write the robot with links and friction, of motions.")
@mjcf
@options.result()
def diagnose(
    call: Call, cell_path: Path, data_path: Path, holdout: str | None, plan_only: bool,
    cell_out: Path | None, urdf_path: Path | None, mjcf_path: Path | None,
) -> None:
    """Find the causes of the error that the cell's model and the noise do not explain.

    The command tries every effect that the model lacks, at every place where it can act. It also tries
    free curves. They locate errors whose cause is not in the catalogue.

    DATA may be motions in the place of points: joint angles and torques, or currents, over time.

    \b
    Example:
      posecal diagnose cell.toml day.csv --holdout 0.3 --json diagnosis.json
      posecal diagnose cell.toml plan.csv --plan-only
    """
    import calib
    from calib.errors import InputError
    from calib.files.cell_out import extended_cell
    from calib.files.motions import holds_motions
    from calib.threads import one_blas_thread
    from studies.results.diagnose import DiagnoseResult

    cell = calib.load_cell(cell_path)
    if plan_only:
        given = {"--holdout": holdout, "--cell-out": cell_out, "--figures": call.folder}
        options.refuse("--plan-only", given, "give one of them")
        foresee_plan(call, cell, data_path)
        return
    if holds_motions(data_path):
        outputs: dict[Form, Path | None] = {"urdf": urdf_path, "mjcf": mjcf_path}
        deliver_motions(call, cell, data_path, holdout, "diagnose", outputs, cell_out)
        return
    if urdf_path or mjcf_path:
        what, remedy = "go with motions", "use identify --urdf for points"
        raise InputError("--urdf and --mjcf", "", what, remedy)
    with working(f"reading {data_path.name}"):
        day = read_session(cell, data_path, holdout, call.seed)
    inputs = [cell.path, *cell.robot_files, data_path, *day.files]
    call.check([*inputs, *cell.named_files], cell_out)
    with working(f"diagnosing {len(day.data)} readings", _SECONDS * len(day.data)):
        with options.faults_in(data_path, effects_of=cell.path):
            found = calib.diagnose(cell, day.data, heldout=day.heldout)
        result = one_blas_thread(DiagnoseResult.of)(
            found, cell, call.envelope(cell, inputs),
            figures=call.json_path is not None or call.folder is not None,
            holdout=holdout,
            warnings=day.warnings,
        )
    texts: dict[Path, str | bytes] = {}
    notes: list[str] = []
    if cell_out is not None:
        effects = [cause.named.candidate.effect for cause in found.causes]
        made = extended_cell(cell, effects, found.data.poses, cell_out)
        texts[cell_out], notes = made.text, [f"{cell_out}: {note}" for note in _notes(made, found)]
    call.deliver(result, texts, notes=notes)


# fmt: on
def foresee_plan(call: Call, cell: Cell, plan_path: Path) -> None:
    """State what a plan, or the readings of a table without their points, could show."""
    import calib
    from calib.files.tables import holds_points
    from doe.forecast.foresee import foresee
    from studies.results.plan import PlanResult

    inputs = [cell.path, *cell.robot_files, plan_path]
    call.check(inputs)
    load = calib.load_measurements if holds_points(plan_path) else calib.load_plan
    plan = load(cell, plan_path)
    with options.faults_in(plan_path, effects_of=cell.path), working("looking ahead"):
        found = foresee(cell, plan)
    call.deliver(PlanResult.of(found, cell, call.envelope(cell, inputs)))


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
