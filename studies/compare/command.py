"""``posecal compare``: which approach, which weighting, which plan, and can it be believed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from studies.command.deliver import check_outputs, deliver, output_file, progress_bar
from studies.command.options import (
    PATH,
    Finite,
    cell_argument,
    engine_options,
    faults_in,
    plan_names,
    processes,
    result_options,
)

if TYPE_CHECKING:
    from studies.compare.compare import Truth


@click.command()
@cell_argument
@click.argument(
    "plan_paths",
    metavar="PLAN [PLAN ...]",
    nargs=-1,
    required=True,
    type=PATH,
)
@click.option(
    "--monte-carlo",
    "trials",
    metavar="N",
    type=click.IntRange(min=0, max=1_000_000),
    default=200,
    show_default=True,
    help="Simulated experiments for each plan. 0: only predict.",
)
@engine_options
@click.option(
    "--length-mm",
    metavar="MM",
    type=Finite(min=1e-3, max=1e6),
    default=1000.0,
    show_default=True,
    help="Length that converts rotations to mm in the plain weighting: about the size of the "
    "marker set.",
)
@click.option("--with", "with_paths", metavar="CELL", multiple=True, type=PATH,
              help="Another cell of this robot, with other instruments, to compare at the same poses. "
              "Can be given several times.")  # fmt: skip
@click.option("--values", "values_path", metavar="RESULT", type=PATH,
              help="Predict and simulate at the values of this result of identify.")  # fmt: skip
@click.option("--truth", type=click.Choice(["model", "mujoco"]),
              help="Simulate readings by the model itself, or by an arm in MuJoCo. MuJoCo also shows "
              "faults in the program's kinematics and torques. Default: mujoco where it is installed "
              "and can simulate the cell's effects.")  # fmt: skip
@result_options()
def compare(
    cell_path: Path,
    plan_paths: tuple[Path, ...],
    trials: int,
    workers: int | None,
    scheduler: str | None,
    length_mm: float,
    with_paths: tuple[Path, ...],
    values_path: Path | None,
    truth: Truth | None,
    folder: Path | None,
    json_path: str | None,
    seed: int,
) -> None:
    """Predict and simulate the accuracy of each PLAN, for the marker-points and full-pose methods.

    Each simulated experiment takes readings of an arm in MuJoCo, or of the full model. Every method is
    fitted to them. One experiment in twenty is treated as real data. The noise is that of CELL, not the
    weights of the fits. If simulation and prediction disagree, the command says by how much and why.

    \b
    Example:
      posecal compare cell.toml plan_a.csv plan_b.csv --monte-carlo 1000
      posecal compare tracker.toml plan.csv --with camera.toml --monte-carlo 0
    """
    import calib
    from calib.errors import InputError
    from calib.files.estimate import load_values
    from calib.model.build import build
    from studies.compare.compare import compare as compare_plans
    from studies.compare.make import compare_record
    from studies.compare.montecarlo import MOST_TRIALS
    from studies.compare.prediction import read_by_each
    from studies.compare.stated_noise import stated_noise
    from studies.engines import engine
    from studies.record import envelope

    cell = calib.load_cell(cell_path)
    inputs = [cell_path, *cell.robot_files, *plan_paths, *cell.named_files]
    others = {path: calib.load_cell(path) for path in with_paths}
    inputs += [*others, *([values_path] if values_path is not None else [])]
    check_outputs([output_file(json_path)], inputs, folder)
    loaded = [calib.load_plan(cell, path) for path in plan_paths]
    names = plan_names(plan_paths)
    for path in plan_paths:
        if names.count(str(path)) > 1 or plan_paths.count(path) > 1:
            raise InputError(path, "", "is given twice", "give each plan once")
    plans = dict(zip(names, loaded, strict=True))
    with faults_in(cell_path, effects_of=cell_path):
        values = None
        if values_path is not None:
            values = load_values(values_path, build(cell, loaded[0]).model.parameters)
        with (
            engine(processes(workers, trials > MOST_TRIALS), scheduler) as executor,
            progress_bar(trials * len(plans), "simulated experiments") as progress,
        ):
            result = compare_plans(
                cell,
                plans,
                trials=trials,
                values=values,
                truth=truth,
                stated=stated_noise(cell_path, cell.instruments),
                length=length_mm / 1e3,
                seed=seed,
                executor=executor,
                progress=progress,
            )
    files = dict(zip(names, plan_paths, strict=True))
    read_by = list(read_by_each({cell_path: cell, **others}, files)) if others else []
    made_from = envelope(cell.name, inputs, seed)
    record = compare_record(result, made_from, curves=folder is not None, read_by=read_by)
    deliver(record, json_path, folder)
