"""``posecal compare``: which approach, which weighting, which plan, and can the figures be believed."""

from __future__ import annotations

import os
from pathlib import Path

import click

from studies.command import options
from studies.command.call import Call, working


# fmt: off
@click.command()
@options.cell
@click.argument("plan_paths", metavar="PLAN [PLAN ...]", nargs=-1, required=True, type=options.PATH)
@options.value("--monte-carlo trials", "N", "Simulated experiments for each plan. 0: only predict.",
               click.IntRange(0, 1_000_000), default=200, show_default=True)
@options.value("--workers", "N", "Number of processes. Default: one for each processor.",
               click.IntRange(min=1))
@options.value("--scheduler", "ADDRESS",
               "Compute on a dask scheduler, such as tcp://host:8786.", str)
@options.result()
def compare(
    call: Call, cell_path: Path, plan_paths: tuple[Path, ...], trials: int, workers: int | None,
    scheduler: str | None,
) -> None:
    """Predict and simulate the accuracy of each PLAN, for the marker-points and full-pose methods.

    Each simulated experiment takes readings of the full model of a robot that has plausible errors,
    with the noise of CELL. Every method is fitted to them. If simulation and prediction disagree, the
    command says so.

    \b
    Example:
      posecal compare cell.toml plan_a.csv plan_b.csv --monte-carlo 1000
    """
    import calib
    from calib.errors import InputError
    from studies.compare.simulate import MOST_TRIALS, engine
    from studies.results.compare import CompareResult, compared

    cell = calib.load_cell(cell_path)
    inputs = [cell_path, *cell.robot_files, *plan_paths, *cell.named_files]
    call.check(inputs)
    for path in plan_paths:
        if plan_paths.count(path) > 1:
            raise InputError(path, "", "is given twice", "give each plan once")
    loaded = [calib.load_plan(cell, path) for path in plan_paths]
    plans = dict(zip(options.plan_names(plan_paths), loaded, strict=True))
    several = len(os.sched_getaffinity(0)) if trials > MOST_TRIALS else 1
    with (
        options.faults_in(cell_path, effects_of=cell_path),
        engine(workers or several, scheduler) as executor,
        working("simulated experiments", total=trials * len(plans)) as progress,
    ):
        found = compared(cell, plans, trials, seed=call.seed, executor=executor, progress=progress)
    call.deliver(CompareResult.of(cell, found, trials, call.envelope(cell, inputs)))
