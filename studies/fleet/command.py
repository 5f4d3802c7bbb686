"""``posecal fleet``: every robot below a folder, identified and diagnosed, and told together."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from studies.command.deliver import check_outputs, deliver, output_file, progress_bar, show
from studies.command.options import PATH, engine_options, processes, result_options

if TYPE_CHECKING:
    from studies.fleet.tables import FleetTask, TableJob, TableOutcome
    from studies.prior import PriorRecord


@click.command()
@click.argument("fleet_folder", metavar="FOLDER", type=PATH)
@click.option("--only", type=click.Choice(["identify", "diagnose"]), default=None,
              help="Run one of the two. A diagnosis takes a hundred times as long.")  # fmt: skip
@click.option(
    "--holdout",
    metavar="NAME|FRACTION",
    help="Held-out poses: a table of this name beside each other table, or a share of the "
    "configurations.",
)
@click.option("--prior", "prior_path", metavar="FILE", type=PATH,
              help="Write a prior for each type of robot, for [model.prior].")  # fmt: skip
@engine_options
@result_options()
def fleet(
    fleet_folder: Path,
    only: str | None,
    holdout: str | None,
    prior_path: Path | None,
    workers: int | None,
    scheduler: str | None,
    folder: Path | None,
    json_path: str | None,
    seed: int,
) -> None:
    """Identify and diagnose every robot below FOLDER, and compare the robots.

    A robot is a cell.toml, or another TOML file with a [robot] table. Measurement tables beside and
    below it belong to it. Results are written beside each table: measurements.identify.json,
    measurements.diagnose.json. A result is reused if cell, robot, table, options and version did
    not change. To continue an interrupted run, give the same command again. A fault in one robot is
    one line of the summary. The status is 2 only if no robot could be processed. Workers of a
    scheduler need FOLDER under the same path.

    --prior writes what the robots of a type have in common: mean, spread and correlations of their
    parameters. A cell with [model.prior] file = "type.json" uses it and needs fewer poses.

    \b
    Example:
      posecal fleet plant --only identify --holdout 0.3 --json plant.json
      posecal fleet plant --only identify --prior type.json
    """
    from calib.errors import InputError
    from studies.document import plural
    from studies.document.terminal import terminal
    from studies.engines import engine
    from studies.fleet.make import fleet_record, results_of
    from studies.fleet.tables import VERBS, FleetTask, find, share
    from studies.kinds import tell
    from studies.record import envelope

    if not fleet_folder.is_dir():
        raise InputError(fleet_folder, "", "is no folder", "name one with cells below it")
    jobs = find(fleet_folder, None if share(holdout) else holdout)
    if not any(job.table for job in jobs):
        what = f"{len(jobs)} cells and no table" if jobs else "no cell.toml"
        raise InputError(
            fleet_folder, "", f"holds {what}", "put tables of measurements beside cells"
        )
    if prior_path is not None and only == "diagnose":
        raise InputError("--prior", "", "learns from identify", "drop --only diagnose")
    inputs = dict.fromkeys(path for job in jobs for path in (job.cell, job.table) if path)
    check_outputs(
        [output_file(json_path), prior_path], [path for path in inputs if path.is_file()], folder
    )
    asked = FleetTask(
        tuple(v for v in VERBS if only in (None, v)), holdout, seed, prior_path is not None
    )
    with (
        engine(processes(workers, len(jobs) > 1), scheduler) as executor,
        progress_bar(len(jobs), "tables") as progress,
    ):
        done = _done(jobs, asked, executor, progress)
    if not any(own.files for own in done):
        raise InputError(fleet_folder, "", f"no robot could be done: {done[0].fault}")
    made_from = envelope("", [], seed)
    made_from["inputs"] = results_of(done)
    record = fleet_record(done, str(fleet_folder), asked, made_from)
    known = {} if prior_path is None else {prior_path: _prior(done, fleet_folder, seed)}
    texts = {path: prior.dumps() for path, prior in known.items()}
    deliver(record, json_path, folder, texts)
    for prior in known.values():
        show(terminal(tell(prior)), json_path)
    kept, files = sum(own.kept for own in done), sum(len(own.files) for own in done)
    said = f"{plural(files - kept, 'result')} written beside the tables, {kept} kept"
    click.echo(said, err=json_path == "-")


def _prior(done: Sequence[TableOutcome], fleet_folder: Path, seed: int) -> PriorRecord:
    """What the types know. Raises InputError where no robot says anything."""
    from calib.errors import InputError
    from studies.fleet.make import latest, results_of, type_priors
    from studies.prior import PriorRecord
    from studies.record import envelope

    types = tuple(type_priors(latest(done)))
    if not types:
        raise InputError(
            fleet_folder, "", "no robot could be identified by itself, so no type is learnt",
            "mend the faults, or take [model.prior] out of the cells",
        )  # fmt: skip
    made_from = envelope("", [], seed)
    made_from["inputs"] = tuple(
        file for file in results_of(done) if file.file.endswith(".identify.json")
    )
    return PriorRecord(**made_from, folder=str(fleet_folder), types=types)


def _done(
    jobs: Sequence[TableJob],
    asked: FleetTask,
    executor: Executor | None,
    progress: Callable[[int], None],
) -> list[TableOutcome]:
    """What became of every table, in the order of the jobs, whoever was first."""
    from studies.fleet.tables import do

    done: dict[int, TableOutcome] = {}
    names: dict[tuple[tuple[str, str], ...], tuple[tuple[str, str], ...]] = {}
    try:
        several = map if executor is None else executor.map
        for index, own in enumerate(several(do, jobs, [asked] * len(jobs))):
            done[index] = own
            if own.values is not None:  # thousands of robots share the names of a few types
                shared = names.setdefault(own.values.names, own.values.names)
                own.values = replace(own.values, names=shared)
            progress(1)
    except KeyboardInterrupt:
        click.echo(
            f"posecal: interrupted; {len(done)} of {len(jobs)} tables are done and kept: the same "
            "command goes on from there",
            err=True,
        )
        raise click.exceptions.Exit(130) from None
    return [done[index] for index in sorted(done)]
