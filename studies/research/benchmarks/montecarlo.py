"""Simulated experiments a second, by who computes them, and beside a plain loop of single refits.

    python -m studies.research.benchmarks.montecarlo [--trials 1000] [--repeats 3] [--json FILE]

The cases are Table II of the paper (fifteen poses, free and loaded, three markers, approach points)
with 9, 24 and 42 parameters, and its Table I. Times are medians of the repeats; "started" counts the
start and the end of the processes too, the other rows find them warm. The loop hands the same readings
one by one to SciPy's ``least_squares`` (``lm``) with the same residuals and analytic derivatives; its
seconds are those of a few trials times what all would take. "apart" is the largest distance between
its estimates and ours, in standard deviations.
"""

from __future__ import annotations

import os
import platform
import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeVar

import click
import numpy as np
from rich.table import Table
from scipy.optimize import least_squares

from calib.arrays import Array
from calib.files.write import json_text, write_files
from calib.threads import one_blas_thread
from studies.command.deliver import console_for
from studies.command.options import one_line_faults
from studies.compare.experiment import PLAIN, POINTS, Experiment, experiment_of
from studies.compare.montecarlo import MOST_TRIALS, Refits, refits
from studies.compare.prediction import Prediction, predict
from studies.demo.embedded import embedded_plan
from studies.engines import engine
from studies.research.paper import table_one
from studies.research.paper.elastostatic import cell_of_section_five
from studies.tables import number, plain_table

WORKERS = 2
SEED = 0
_HEADINGS = (
    ("\ncase", "left"), ("\np", "right"), ("\ncomputed by", "left"), ("\n[s]", "right"),
    ("trials\n[1/s]", "right"), ("times as fast\nas one worker", "right"),
    ("times as fast\nas the loop", "right"), ("same to the\nlast digit", "right"),
    ("apart\n[std]", "right"),
)  # fmt: skip

Row = dict[str, Any]  # heading -> figure
T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Case:
    """A plan with the ways by which its trials are fitted."""

    name: str
    experiment: Experiment
    predictions: Sequence[Prediction]

    def run(self, trials: int, executor: Executor | None = None) -> Refits:
        """Trials from the benchmark's seed, by a model that remembers nothing of those before."""
        fresh = replace(self.experiment, model=replace(self.experiment.model))
        return refits(fresh, self.predictions, trials, seed=SEED, executor=executor)


def cases() -> Iterator[Case]:
    """Table II with 9, 24 and 42 parameters, and Table I by one approach and by both."""
    for name, effects in (
        ("Table II", ()),
        ("Table II, base, tool", ("base", "tool")),
        ("Table II, geometry", ("base", "tool", "geometry")),
    ):
        cell = cell_of_section_five(*effects)
        experiment = experiment_of(cell, embedded_plan(cell))
        yield Case(name, experiment, [predict(experiment, POINTS)])
    experiment = table_one.experiment_at(table_one.embedded_setting())
    found = table_one.predictions_at(experiment)
    yield Case("Table I, points", experiment, [found[POINTS.key]])
    yield Case("Table I, plain and points", experiment, [found[PLAIN.key], found[POINTS.key]])


def timed(work: Callable[[], T], repeats: int) -> tuple[T, float]:
    """Result and median seconds."""
    seconds = []
    for _ in range(repeats):
        begun = time.perf_counter()
        result = work()
        seconds.append(time.perf_counter() - begun)
    return result, statistics.median(seconds)


def same(a: Refits, b: Refits) -> bool:
    """Whether two studies agree to the last digit."""
    pairs: list[tuple[Any, Any]] = [(a.errors[way], b.errors[way]) for way in a.errors]
    pairs += [(a.settled[way], b.settled[way]) for way in a.errors]
    return a.errors.keys() == b.errors.keys() and all(np.array_equal(*pair) for pair in pairs)


def measured(case: Case, warm: dict[str, Executor], trials: int, repeats: int) -> Iterator[Row]:
    """The case by one worker, by processes with their start, and by engines that are started.

    warm : label -> executor
    """
    here, alone = timed(lambda: case.run(trials), repeats)
    yield row(case, "1 worker", alone, trials)

    def started() -> Refits:
        with engine(WORKERS) as pool:
            return case.run(trials, pool)

    runs = {f"{WORKERS} workers, started": started}
    runs |= {name: lambda e=e: case.run(trials, e) for name, e in warm.items()}  # type: ignore[misc]
    for name, run in runs.items():
        there, seconds = timed(run, repeats)
        found = row(case, name, seconds, trials)
        yield {**found, "over one worker": alone / seconds, "same": same(here, there)}


def row(case: Case, by: str, seconds: float, trials: int) -> Row:
    """One line of the table."""
    p = len(case.experiment.nominal)
    return {"case": case.name, "p": p, "by": by, "seconds": seconds, "rate": trials / seconds}


def looped(case: Case, count: int, trials: int) -> Row:
    """A few trials one by one, their seconds extrapolated to all."""
    points = first_readings(case.experiment, count, trials)
    begun = time.perf_counter()
    estimates = [[single(case, way, own) for own in points] for way in case.predictions]
    seconds = (time.perf_counter() - begun) * trials / count
    ours = case.run(trials)
    apart = [
        np.abs(np.array(own) - case.experiment.truth - ours.errors[way.way.key][:count]) / way.std
        for way, own in zip(case.predictions, estimates, strict=True)
    ]
    found = row(case, f"loop, from {count} trials", seconds, trials)
    return {**found, "apart": float(np.nanmax(apart))}


def first_readings(experiment: Experiment, count: int, trials: int) -> Array:
    """The readings of the first trials, as ``refits`` draws them, (count, m, M, 3), m."""
    blocks = -(-trials // MOST_TRIALS)
    seed = np.random.SeedSequence(SEED).spawn(blocks)[0]
    exact = experiment.model.predict(experiment.truth, experiment.poses)
    white = np.random.default_rng(seed).standard_normal((count, *exact.shape, 1))
    return np.asarray(exact + (np.linalg.pinv(experiment.weights) @ white)[..., 0])


@one_blas_thread
def single(case: Case, prediction: Prediction, points: Array) -> Array:
    """One trial by SciPy, shape (p,), SI; steps in standard deviations.

    points : ndarray, shape (m, M, 3), m
    """
    observation, start = case.experiment.observe(prediction.way, points)
    span = prediction.span * np.nan_to_num(prediction.std)[:, None]
    found = least_squares(
        lambda steps: observation.flat(start + span @ steps)[0],
        np.zeros(span.shape[1]),
        jac=lambda steps: -observation.flat(start + span @ steps)[1] @ span,
        method="lm",
    )
    return np.asarray(start + span @ found.x)


@contextmanager
def engines() -> Iterator[tuple[dict[str, Executor], list[str]]]:
    """Processes and a dask cluster of this machine, warm, and what is absent."""
    absent: list[str] = []
    with ExitStack() as stack:
        pool = stack.enter_context(engine(WORKERS))
        assert pool is not None  # noqa: S101
        warm = {f"{WORKERS} workers": pool}
        try:
            address = stack.enter_context(cluster())
        except ImportError:
            absent.append("no figures for dask: pip install 'posecal[cluster]'")
        else:
            dask = stack.enter_context(engine(scheduler=address))
            assert dask is not None  # noqa: S101
            warm[f"dask, {WORKERS} workers"] = dask
        yield warm, absent


@contextmanager
def cluster() -> Iterator[str]:
    """Address of a dask cluster of this machine, seen by nobody else.

    Raises ImportError where dask is not installed.
    """
    from distributed import LocalCluster

    own = {"n_workers": WORKERS, "threads_per_worker": 1, "host": "127.0.0.1"}
    with LocalCluster(**own, dashboard_address="127.0.0.1:0") as found:
        yield found.scheduler_address


def all_rows(trials: int, repeats: int, loop: int) -> tuple[list[Row], list[str]]:
    """Every case by every engine, and what could not be measured."""
    rows: list[Row] = []
    with engines() as (warm, absent):
        for case in cases():
            for executor in warm.values():
                case.run(4 * WORKERS * MOST_TRIALS, executor)  # imports done on every worker
            own = list(measured(case, warm, trials, repeats))
            own.append(looped(case, min(loop, trials, MOST_TRIALS), trials))
            rows += [
                {**found, "over the loop": own[-1]["seconds"] / found["seconds"]} for found in own
            ]
    return rows, absent


def table(rows: list[Row]) -> Table:
    """The rows under their headings."""
    shown = plain_table(*_HEADINGS)
    last = ""
    for found in rows:
        head = ("", "") if found["case"] == last else (found["case"], str(found["p"]))
        last = found["case"]
        alike = {None: "-", True: "yes", False: "no"}[found.get("same")]
        keys = ("seconds", "rate", "over one worker", "over the loop")
        figures = [number(found.get(key)) for key in keys]
        shown.add_row(*head, found["by"], *figures, alike, number(found.get("apart")))
    return shown


def run_fields(trials: int, repeats: int, load: Sequence[float]) -> Row:
    """What the figures were measured with; load is that of the machine before."""
    versions = {name: version(name) for name in ("posecal", "numpy", "scipy")}
    where = {"python": platform.python_version(), "platform": platform.platform()}
    asked = {"trials": trials, "repeats": repeats}
    return {**where, **versions, "cores": os.cpu_count(), "load": list(load), **asked}


@click.command()
@click.option("--trials", type=click.IntRange(min=1), default=1000, show_default=True,
              help="Simulated experiments of each case.")  # fmt: skip
@click.option("--repeats", type=click.IntRange(min=1), default=3, show_default=True,
              help="Runs of which the median counts.")  # fmt: skip
@click.option("--loop", type=click.IntRange(min=1), default=20, show_default=True,
              help=f"Trials of the plain loop, at most {MOST_TRIALS}.")  # fmt: skip
@click.option("--json", "path", type=click.Path(path_type=Path), help="Write the figures as JSON.")
@one_line_faults
def main(trials: int, repeats: int, loop: int, path: Path | None) -> None:
    """Measure the Monte Carlo studies; some minutes with the defaults."""
    load = os.getloadavg()
    rows, absent = all_rows(trials, repeats, loop)
    console = console_for(None)
    console.print(
        f"{trials} simulated experiments, median of {repeats} runs; {os.cpu_count()} processors, "
        f"load {load[0]:.1f} before\n"
    )
    console.print(table(rows))
    for line in absent:
        console.print(line)
    if path is not None:
        write_files({path: json_text({"run": run_fields(trials, repeats, load), "rows": rows})})
        console.print(f"wrote {path}")


if __name__ == "__main__":
    main()
