"""Seconds of commands and of calls in the library, and how they grow: median, least and most.

    python -m studies.research.speed [--only NAME] .. [--repeats 5] [--json FILE]

Every figure is that of processes of their own. Commands count from their start to their end; what is
said "in the library" counts without imports and files. Bytecode is kept, in a folder of the run, and
written by a run that does not count. A figure in "x" is a time divided by another.
"""

from __future__ import annotations

import json
import os
import resource  # not on Windows
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import click

import calib
from studies.research import problems
from studies.research.bench import Output, Row, bench, count, real_data, table

RUN = "from studies.cli import run; run()"
TRIALS, WORKERS = 1000, 2
_MB = 1e6 if sys.platform == "darwin" else 1e6 / 1024
Runs = Callable[[int], list[float]]
"""How many repeats -> seconds of each, or ratios."""


def seconds(work: Callable[[], Any]) -> float:
    """Of one run."""
    begun = time.perf_counter()
    work()
    return time.perf_counter() - begun


# -- commands --------------------------------------------------------------------------------------


def process(arguments: Sequence[str], repeats: int, folder: Path | None = None) -> list[float]:
    """Runs of one command of this interpreter, after one that does not count."""
    run = partial(
        subprocess.run, [sys.executable, *arguments], check=True, stdout=subprocess.DEVNULL
    )
    with TemporaryDirectory() as name:
        times = [seconds(lambda: run(cwd=folder or name)) for _ in range(repeats + 1)]
    return times[1:]


def command(*arguments: str, folder: Path | None = None) -> Runs:
    """Runs of ``posecal`` itself."""
    return partial(process, ["-c", RUN, *arguments], folder=folder)


def design(p: int, candidates: int, *more: str) -> Runs:
    """``posecal design`` of the embedded cell, with its 42 parameters or the elastic 9 alone."""
    from studies.demo.embedded import embedded_text

    def measure(repeats: int) -> list[float]:
        lines = embedded_text("cell.toml").splitlines()
        if p == 9:
            model = next(i for i, line in enumerate(lines) if line.startswith("effects ="))
            lines[model] = f"effects = {json.dumps(problems.ELASTIC)}"
        with TemporaryDirectory() as name:
            (Path(name) / "cell.toml").write_text("\n".join(lines))
            (Path(name) / "kr270.urdf").write_text(embedded_text("kr270.urdf"))
            asked = ["--criterion", "D", "--candidates", str(candidates), *more]
            call = command("design", "cell.toml", *asked, "-o", "plan.csv", folder=Path(name))
            return call(repeats)

    return measure


# -- in the library --------------------------------------------------------------------------------


def inside(measure: Runs) -> Runs:
    """Runs of a function in one process of their own."""

    def apart(repeats: int) -> list[float]:
        with ProcessPoolExecutor(1, get_context("spawn")) as pool:
            return pool.submit(measure, repeats).result()

    return apart


def most_mb(runs: Runs, repeats: int) -> list[float]:
    """Megabytes at most of one run."""
    runs(min(repeats, 1))
    return [resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / _MB]


def pool(repeats: int) -> list[float]:
    """A million candidates of the paper's problem, weights of the links included."""
    posed = problems.problem(problems.paper_cell(), "D", problems.PAPER_POSES, problems.LEVELS)
    return [seconds(lambda: problems.pool(posed, 1_000_000)) for _ in range(repeats)]


def fits(repeats: int) -> list[float]:
    """Identifications of a real table of 1495 poses; the first does not count."""
    cell, data = real_data("ur10_leica_b")
    # Poses remember results, so that each fit has fresh ones.
    times = [
        seconds(lambda: calib.identify(cell, data.take(slice(None)))) for _ in range(repeats + 1)
    ]
    return times[1:]


def refits(repeats: int) -> list[float]:
    """1000 simulated experiments of 15 poses and 9 parameters."""
    run = _refits()
    run(TRIALS // 10)
    return [seconds(lambda: run(TRIALS)) for _ in range(repeats)]


def two_workers(repeats: int) -> list[float]:
    """The same on one worker as a multiple of two that are started."""
    from studies.compare.simulate import engine

    run = _refits()
    with engine(WORKERS) as two:
        run(TRIALS // 10), run(TRIALS, two)
        alone, shared = partial(run, TRIALS), partial(run, TRIALS, two)
        return [seconds(alone) / seconds(shared) for _ in range(repeats)]


def _refits() -> Callable[..., Any]:
    """Simulated experiments of Table II of the paper, so many, on an executor or here."""
    from studies.compare.experiment import POINTS, experiment_of, predict
    from studies.compare.simulate import refits
    from studies.demo.embedded import embedded_plan
    from studies.research.paper.elastostatic import cell_of_section_five

    cell = cell_of_section_five()
    experiment = experiment_of(cell, embedded_plan(cell))
    found = [predict(experiment, POINTS)]

    def run(trials: int, executor: Any = None) -> Any:
        fresh = replace(experiment, model=replace(experiment.model))  # remembers nothing
        return refits(fresh, found, trials, seed=0, executor=executor)

    return run


SPEEDS: dict[str, tuple[str, str, Runs]] = {
    "import": ("import calib", "s", partial(process, ["-c", "import calib"])),
    "help": ("posecal --help", "s", command("--help")),
    "design": ("posecal design, 1e5 candidates, p 9", "s", design(9, 100_000)),
    "design-42": ("posecal design, 2e4 candidates, p 42", "s", design(42, 20_000)),
    "pool": ("pool of 1e6, link weights, in the library", "s", inside(pool)),
    "pool-mb": ("its memory", "MB", inside(partial(most_mb, pool))),
    "identify": ("identify 1495 x 3, in the library", "s", inside(fits)),
    "refits": ("1000 refits of 15 poses, in the library", "s", inside(refits)),
    "workers": ("their gain by two workers", "x", inside(two_workers)),
    "demo": ("posecal demo", "s", command("demo", "demo")),
}
"""By name: what is measured, its unit, and how."""


def row(name: str, repeats: int) -> Row:
    """Figures of one speed."""
    says, unit, measure = SPEEDS[name]
    times = measure(repeats)
    ends = {"median": statistics.median(times), "least": min(times), "most": max(times)}
    return {"what": says, "unit": unit, **ends}


@bench(
    click.option("--only", "names", multiple=True, type=click.Choice(list(SPEEDS)), help="These."),
    count("--repeats", 5),
)
def main(names: tuple[str, ...], repeats: int, seed: int) -> Output:
    """Measure every speed; some minutes."""
    del seed
    load = os.getloadavg()
    with TemporaryDirectory() as folder:
        os.environ.setdefault("PYTHONPYCACHEPREFIX", folder)
        os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
        rows = [row(name, repeats) for name in names or SPEEDS]
    head = f"{repeats} runs each; {os.cpu_count()} processors, load {load[0]:.1f} before\n"
    return [head, table(rows)], {"cores": os.cpu_count(), "load": list(load), "rows": rows}


if __name__ == "__main__":
    main()
