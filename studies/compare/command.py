"""``posecal compare``: which approach, which weighting, which plan, and can it be believed."""

from __future__ import annotations

import os
from pathlib import Path

import click

from studies.command.deliver import check_outputs, deliver, output_file, progress_bar
from studies.command.options import (
    PATH,
    Finite,
    cell_argument,
    faults_in,
    plan_names,
    result_options,
)


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
@click.option(
    "--workers",
    metavar="N",
    type=click.IntRange(min=1),
    default=None,
    help="Number of processes. Default: one for each processor.",
)
@click.option(
    "--scheduler",
    metavar="ADDRESS",
    default=None,
    help="Compute on a dask scheduler, such as tcp://host:8786.",
)
@click.option(
    "--length-mm",
    metavar="MM",
    type=Finite(min=1e-3, max=1e6),
    default=1000.0,
    show_default=True,
    help="Length that converts rotations to mm in the plain weighting: about the size of the "
    "marker set.",
)
@click.option("--values", "values_path", metavar="RESULT", type=PATH,
              help="Predict and simulate at the values of this result of identify.")  # fmt: skip
@result_options()
def compare(
    cell_path: Path,
    plan_paths: tuple[Path, ...],
    trials: int,
    workers: int | None,
    scheduler: str | None,
    length_mm: float,
    values_path: Path | None,
    folder: Path | None,
    json_path: str | None,
    seed: int,
) -> None:
    """Predict and simulate the accuracy of each PLAN, for the marker-points and full-pose methods.

    Each simulated experiment takes readings of the full model of a robot that has plausible errors,
    with the noise of CELL. Every method is fitted to them. If simulation and prediction disagree, the
    command says by how much.

    \b
    Example:
      posecal compare cell.toml plan_a.csv plan_b.csv --monte-carlo 1000
    """
    import calib
    from calib.errors import InputError
    from calib.files.estimate import load_values
    from calib.model.build import build
    from studies.compare.compare import compare as compare_plans
    from studies.compare.make import compare_record
    from studies.compare.montecarlo import MOST_TRIALS
    from studies.engines import engine
    from studies.record import envelope

    cell = calib.load_cell(cell_path)
    inputs = [cell_path, *cell.robot_files, *plan_paths, *cell.named_files]
    inputs += [values_path] if values_path is not None else []
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
        several = len(os.sched_getaffinity(0)) if trials > MOST_TRIALS else 1
        with (
            engine(workers or several, scheduler) as executor,
            progress_bar(trials * len(plans), "simulated experiments") as progress,
        ):
            result = compare_plans(
                cell,
                plans,
                trials=trials,
                values=values,
                length=length_mm / 1e3,
                seed=seed,
                executor=executor,
                progress=progress,
            )
    record = compare_record(result, envelope(cell.name, inputs, seed))
    deliver(record, json_path, folder)
