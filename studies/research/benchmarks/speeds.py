"""What is asked of speed, and what is so here: median, least and most of several runs.

    python -m studies.research.benchmarks.speeds [--only NAME] .. [--repeats 5] [--json FILE]

Commands count from the start of their process to its end, their children included; what is said "in
the library" counts without imports and files. Bytecode is kept, in a folder of the run, and written by
a run that does not count. "CPU" is user and system time, of all processes: other work on the machine
disturbs it less than the clock, but two workers do not shorten it. What is asked is compared with the
clock's median.
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
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import click

from studies.research.bench import Output, Row, bench, count, table

RUN = "from studies.cli import run; run()"
TRIALS, WORKERS = 1000, 2


class Sample(NamedTuple):
    """One run: s by the clock, s of processors, MB at most."""

    wall: float
    cpu: float
    peak: float = float("nan")

    def over(self, other: Sample) -> Sample:
        """As a multiple of another."""
        return Sample(self.wall / other.wall, self.cpu / other.cpu)


@dataclass(frozen=True)
class Speed:
    """What is asked of one figure.

    limit, unit : what it must stay below, or reach if ``at_least``, s or x
    measure : samples of so many runs; most_mb : of memory, if that is asked too
    """

    says: str
    limit: float
    measure: Callable[[int], list[Sample]]
    unit: str = "s"
    at_least: bool = False
    most_mb: float | None = None


def process(arguments: Sequence[str], repeats: int) -> list[Sample]:
    """Runs of one command of this interpreter, after one that does not count."""
    with TemporaryDirectory() as folder:
        return [_process(arguments, folder) for _ in range(repeats + 1)][1:]


def _process(arguments: Sequence[str], folder: str) -> Sample:
    before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    run = [sys.executable, *arguments]
    subprocess.run(run, check=True, stdout=subprocess.DEVNULL, cwd=folder)  # noqa: S603
    wall, after = time.perf_counter() - begun, resource.getrusage(resource.RUSAGE_CHILDREN)
    return Sample(wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)


def command(*arguments: str) -> Callable[[int], list[Sample]]:
    """Runs of ``posecal`` itself."""
    return partial(process, ["-c", RUN, *arguments])


def design(p: int, count: int, *more: str, criterion: str = "D") -> Callable[[int], list[Sample]]:
    """``posecal design`` of the embedded cell, with its 42 parameters or the elastic 9 alone."""

    def measure(repeats: int) -> list[Sample]:
        with TemporaryDirectory() as name:
            cell, folder = paper_cell(Path(name), p), ["-o", f"{name}/plan.csv"]
            asked = ["--criterion", criterion, "--candidates", str(count), *more, *folder]
            return command("design", str(cell), *asked)(repeats)

    return measure


def curve(repeats: int) -> list[Sample]:
    """A design with its curve, as a multiple of the one without."""
    plain, curved = (design(9, 10_000, *more)(repeats) for more in ((), ("--curve",)))
    return [b.over(a) for a, b in zip(plain, curved, strict=True)]


def paper_cell(folder: Path, p: int) -> Path:
    """The embedded cell as a file."""
    from studies.demo.embedded import embedded_text
    from studies.research.benchmarks.design import ELASTIC

    lines = embedded_text("cell.toml").splitlines()
    if p == 9:
        model = next(i for i, line in enumerate(lines) if line.startswith("effects ="))
        lines[model] = f"effects = {json.dumps(ELASTIC)}"
    (folder / "cell.toml").write_text("\n".join(lines))
    (folder / "kr270.urdf").write_text(embedded_text("kr270.urdf"))
    return folder / "cell.toml"


def inside(name: str) -> Callable[[int], list[Sample]]:
    """Runs of a function of ``LIBRARY`` in one process of their own, the first not counted."""

    def measure(repeats: int) -> list[Sample]:
        run = [sys.executable, "-m", "studies.research.benchmarks.speeds", "--inside", name]
        done = subprocess.run(  # noqa: S603
            [*run, "--repeats", str(repeats)], check=True, stdout=subprocess.PIPE
        )
        return [Sample(*own) for own in json.loads(done.stdout)]

    return measure


def clocked(work: Callable[[], Any]) -> Sample:
    """One run within this process."""
    cpu, begun = time.process_time(), time.perf_counter()
    work()
    unit = 1e6 if sys.platform == "darwin" else 1e6 / 1024
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit
    return Sample(time.perf_counter() - begun, time.process_time() - cpu, peak)


def pool(repeats: int) -> list[Sample]:
    """A million candidates of the paper's problem, weights of the links included."""
    from studies.research.benchmarks import design

    posed = design.problem("paper", "D")
    return [clocked(lambda: design.pool(posed, 1_000_000)) for _ in range(repeats)]


def identify(repeats: int) -> list[Sample]:
    """1495 poses of three markers, of a real UR10; poses remember results, so each run has its own."""
    import calib
    from studies.research.bench import real_data

    cell, data = real_data("ur10_leica_b")
    fresh = [data.take(slice(None)) for _ in range(repeats + 1)]
    return [clocked(partial(calib.identify, cell, own)) for own in fresh][1:]


def refits(repeats: int) -> list[Sample]:
    """1000 simulated experiments of 15 poses and 9 parameters."""
    run = _refits()
    run(TRIALS // 10)
    return [clocked(lambda: run(TRIALS)) for _ in range(repeats)]


def two_workers(repeats: int) -> list[Sample]:
    """The same on one worker as a multiple of two that are started."""
    from studies.engines import engine

    run, samples = _refits(), []
    with engine(WORKERS) as pool:
        run(TRIALS // 10), run(TRIALS, pool)
        for _ in range(repeats):
            alone = clocked(lambda: run(TRIALS))
            samples.append(alone.over(clocked(lambda: run(TRIALS, pool))))
    return [
        Sample(wall, float("nan")) for wall, *_ in samples
    ]  # workers' time is not this process's


def _refits() -> Callable[..., Any]:
    """Simulated experiments of Table II of the paper, so many, on an executor or here."""
    from studies.compare.experiment import POINTS, experiment_of
    from studies.compare.montecarlo import refits
    from studies.compare.prediction import predict
    from studies.demo.embedded import embedded_plan
    from studies.research.paper.elastostatic import cell_of_section_five

    cell = cell_of_section_five()
    experiment = experiment_of(cell, embedded_plan(cell))
    found = [predict(experiment, POINTS)]

    def run(trials: int, executor: Any = None) -> Any:
        fresh = replace(experiment, model=replace(experiment.model))  # remembers nothing
        return refits(fresh, found, trials, seed=0, executor=executor)

    return run


LIBRARY = {f.__name__: f for f in (pool, identify, refits, two_workers)}
SPEEDS = {
    "pool": Speed("pool of 1e6, link weights", 5.0, inside("pool"), most_mb=1000.0),
    "design": Speed("posecal design, 1e5 candidates, p 9", 2.0, design(9, 100_000)),
    "design-42": Speed("posecal design, 2e4 candidates, p 42", 4.0, design(42, 20_000)),
    "curve": Speed("design --curve over design, 1e4 candidates", 10.0, curve, "x"),
    "identify": Speed("identify 1495 x 3, in the library", 0.2, inside("identify")),
    "refits": Speed("1000 refits of 15 poses, in the library", 3.0, inside("refits")),
    "workers": Speed("their gain by two workers", 1.7, inside("two_workers"), "x", True),
    "demo": Speed("posecal demo", 20.0, command("demo", "demo")),
    "import": Speed("import calib", 0.15, partial(process, ["-c", "import calib"])),
    "help": Speed("posecal --help", 0.15, command("--help")),
}


def row(name: str, repeats: int) -> dict[str, Any]:
    """Figures of one speed."""
    asked = SPEEDS[name]
    samples = asked.measure(repeats)
    wall, cpu = ([getattr(s, key) for s in samples] for key in ("wall", "cpu"))
    peak, middle = max(s.peak for s in samples), statistics.median(wall)
    met = middle >= asked.limit if asked.at_least else middle <= asked.limit
    if asked.most_mb is not None:
        met = met and peak <= asked.most_mb
    return {
        "name": name, "says": asked.says, "unit": asked.unit, "asked": asked.limit,
        "asked_mb": asked.most_mb, "wall": wall, "cpu": cpu, "peak_mb": peak, "met": met,
    }  # fmt: skip


def _told(row: Row) -> Row:
    asked = SPEEDS[row["name"]]
    wall, cpu = row["wall"], row["cpu"]
    return {
        "what": row["says"],
        "asked": f"{'>=' if asked.at_least else '<='} {asked.limit:g} {asked.unit}",
        "median": statistics.median(wall),
        "least .. most": f"{min(wall):.4g} .. {max(wall):.4g}",
        "CPU": statistics.median(cpu),
        "its least .. most": f"{min(cpu):.4g} .. {max(cpu):.4g}",
        "MB": asked.most_mb and f"{row['peak_mb']:.0f} of {asked.most_mb:.0f}",
        "met": row["met"],
    }


@bench(
    click.option(
        "--only", "names", multiple=True, type=click.Choice(list(SPEEDS)), help="These alone."
    ),
    count("--repeats", 5),
    click.option("--inside", "own", type=click.Choice(list(LIBRARY)), hidden=True),
)
def main(names: tuple[str, ...], repeats: int, own: str | None, seed: int) -> Output:
    """Measure every speed that is asked for; some minutes."""
    del seed
    if own is not None:
        return [json.dumps(LIBRARY[own](repeats))], None
    load = os.getloadavg()
    with TemporaryDirectory() as folder:
        os.environ.setdefault("PYTHONPYCACHEPREFIX", folder)
        os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
        rows = [row(name, repeats) for name in names or SPEEDS]
    head = f"{repeats} runs each; {os.cpu_count()} processors, load {load[0]:.1f} before\n"
    found = {"cores": os.cpu_count(), "load": list(load), "rows": rows}
    return [head, table(map(_told, rows))], found


if __name__ == "__main__":
    main()
