"""Seconds of commands and of calls in the library, and how they grow: median, least and most.

    python -m studies.research.benchmarks.speeds [--only NAME] .. [--repeats 5] [--json FILE]

Every figure is that of processes of their own. Commands count from their start to their end; what is
said "in the library" counts without imports and files. Bytecode is kept, in a folder of the run, and
written by a run that does not count. A figure in "x" is a time divided by another.

Readings of one marker stand in 40 stays, as a motion capture writes of an arm that waits: it scatters
by 0.03 mm from approach to approach, the instrument by 0.01 mm.
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
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import click
import numpy as np

from calib.errors import CalibError
from studies.research.bench import Output, Row, bench, count, table

RUN = "from studies.cli import run; run()"
TRIALS, WORKERS, STAYS = 1000, 2, 40
_SCATTER = 30e-6  # m, 3-D RMS of the tip
_MB = 1e6 if sys.platform == "darwin" else 1e6 / 1024

Runs = Callable[[int], list[float]]
"""How many repeats -> seconds of each, or ratios."""


def command(*arguments: str, folder: Path | None = None) -> Runs:
    """Runs of ``posecal`` itself."""
    return partial(process, ["-c", RUN, *arguments], folder=folder)


def process(arguments: Sequence[str], repeats: int, folder: Path | None = None) -> list[float]:
    """Runs of one command of this interpreter, after one that does not count."""

    def once(where: Path) -> float:
        begun = time.perf_counter()
        run = [sys.executable, *arguments]
        subprocess.run(run, check=True, stdout=subprocess.DEVNULL, cwd=where)  # noqa: S603
        return time.perf_counter() - begun

    with TemporaryDirectory() as name:
        return [once(folder or Path(name)) for _ in range(repeats + 1)][1:]


def design(p: int, candidates: int, *more: str) -> Runs:
    """``posecal design`` of the embedded cell, with its 42 parameters or the elastic 9 alone."""

    def measure(repeats: int) -> list[float]:
        with TemporaryDirectory() as name:
            cell = paper_cell(Path(name), p)
            asked = ["--criterion", "D", "--candidates", str(candidates), *more]
            return command("design", str(cell), *asked, "-o", f"{name}/plan.csv")(repeats)

    return measure


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


def readings(number: int, asked: str = "identify") -> Runs:
    """A table of so many readings of one marker in 40 stays."""

    def measure(repeats: int) -> list[float]:
        from studies.research.benchmarks.day import SIGMA, Setting, draw_day, write_day

        day = draw_day(Setting("6R", _SCATTER, 1, STAYS, 1), 0, 0)
        rng = np.random.default_rng([0, number])
        stay = np.sort(np.arange(number) % STAYS)
        stood = day.approach(day.q, rng)[stay]
        read = stood + rng.normal(size=stood.shape) * SIGMA
        names = tuple(f"r{i}" for i in range(number))
        day = replace(day, names=names, q=day.q[stay], exact=day.exact[stay], read=read)
        with TemporaryDirectory() as name:
            write_day(Path(name), day)
            return command(asked, "cell.toml", "measurements.csv", folder=Path(name))(repeats)

    return measure


def ratio(above: Runs, below: Runs) -> Runs:
    """One time as a multiple of another."""
    return lambda repeats: [a / b for a, b in zip(above(repeats), below(repeats), strict=True)]


def inside(name: str) -> Runs:
    """Runs of a function of ``LIBRARY`` in one process of their own."""

    def measure(repeats: int) -> list[float]:
        run = [sys.executable, "-m", "studies.research.benchmarks.speeds", "--inside", name]
        done = subprocess.run([*run, "--repeats", str(repeats)], stdout=subprocess.PIPE)  # noqa: S603
        if done.returncode:
            raise CalibError(f"{name} was not measured; see the line above")
        return [float(value) for value in json.loads(done.stdout)]

    return measure


def clocked(work: Callable[[], Any]) -> float:
    """Seconds of one run within this process."""
    begun = time.perf_counter()
    work()
    return time.perf_counter() - begun


def pool(repeats: int) -> list[float]:
    """A million candidates of the paper's problem, weights of the links included."""
    from studies.research.benchmarks import design

    posed = design.problem("paper", "D")
    return [clocked(lambda: design.pool(posed, 1_000_000)) for _ in range(repeats)]


def pool_mb(repeats: int) -> list[float]:
    """Megabytes at most while they are linearised."""
    pool(min(repeats, 1))
    return [resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / _MB]


def identify(repeats: int) -> list[float]:
    """1495 poses of three markers, of a real UR10; poses remember results, so each run has its own."""
    import calib
    from studies.research.bench import real_data

    cell, data = real_data("ur10_leica_b")
    fresh = [data.take(slice(None)) for _ in range(repeats + 1)]
    return [clocked(partial(calib.identify, cell, own)) for own in fresh][1:]


def images(repeats: int) -> list[float]:
    """500 images of 88 corners by a camera on a Panda's hand, 34 parameters."""
    import calib

    cell, data = _filmed(500)
    fresh = [data.take(slice(None)) for _ in range(repeats + 1)]
    return [clocked(partial(calib.identify, cell, own)) for own in fresh][1:]


def _filmed(count: int) -> tuple[Any, Any]:
    import calib
    from studies.research.benchmarks.lenses import written

    with TemporaryDirectory() as folder:
        path, table_path = written(Path(folder), "N", 0, count)
        cell = calib.load_cell(path)
        return cell, calib.load_measurements(cell, table_path)


def _tracked(count: int) -> tuple[Any, Any]:
    """Readings of three markers on a real IRB 120 whose joint 2 turns too far and joint 4 has play."""
    import calib
    from calib.poses import poses_at
    from calib.poses.moves import with_moves
    from studies.research.bench import real_data

    cell, data = real_data("irb120_faro")
    rng = np.random.default_rng(0)
    q = rng.uniform(data.poses.q.min(axis=0), data.poses.q.max(axis=0), (count, 6))
    poses = with_moves(poses_at(q))
    turned = q * [1.0, 1.0 + 2e-4, 1.0, 1.0, 1.0, 1.0]
    turned[:, 3] += 1e-4 * np.sign(np.diff(q[:, 3], prepend=0.0))
    read = calib.simulate(cell, replace(poses, q=turned), rng=rng)
    return cell, replace(read, poses=poses)


def _whole(of: Callable[[], tuple[Any, Any]], repeats: int) -> list[float]:
    """Seconds of an identification and a diagnosis of the same table, one after the other."""
    import calib

    cell, data = of()

    def work() -> None:
        fresh = data.take(slice(None))
        calib.identify(cell, fresh)
        calib.diagnose(cell, fresh)

    return [clocked(work) for _ in range(max(repeats, 1))]


def _peak(of: Callable[[], tuple[Any, Any]], repeats: int) -> list[float]:
    """Megabytes at most of one such run."""
    del repeats
    _whole(of, 1)
    return [resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / _MB]


def refits(repeats: int) -> list[float]:
    """1000 simulated experiments of 15 poses and 9 parameters."""
    run = _refits()
    run(TRIALS // 10)
    return [clocked(lambda: run(TRIALS)) for _ in range(repeats)]


def two_workers(repeats: int) -> list[float]:
    """The same on one worker as a multiple of two that are started."""
    from studies.compare.engine import engine

    run, found = _refits(), []
    with engine(WORKERS) as pool:
        run(TRIALS // 10), run(TRIALS, pool)
        for _ in range(repeats):
            found.append(clocked(lambda: run(TRIALS)) / clocked(lambda: run(TRIALS, pool)))
    return found


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


_TABLES = {"poses": partial(_tracked, 10_000), "filmed": partial(_filmed, 5000)}
LIBRARY: dict[str, Runs] = {
    **{f.__name__: f for f in (pool, pool_mb, identify, images, refits, two_workers)},
    **{name: partial(_whole, of) for name, of in _TABLES.items()},
    **{f"{name}_mb": partial(_peak, of) for name, of in _TABLES.items()},
}
SPEEDS: dict[str, tuple[str, str, Runs]] = {
    "import": ("import calib", "s", partial(process, ["-c", "import calib"])),
    "help": ("posecal --help", "s", command("--help")),
    "design": ("posecal design, 1e5 candidates, p 9", "s", design(9, 100_000)),
    "design-42": ("posecal design, 2e4 candidates, p 42", "s", design(42, 20_000)),
    "curve": (
        "design --curve over design, 1e4 candidates",
        "x",
        ratio(design(9, 10_000, "--curve"), design(9, 10_000)),
    ),
    "pool": ("pool of 1e6, link weights, in the library", "s", inside("pool")),
    "pool-mb": ("its memory", "MB", inside("pool_mb")),
    "identify": ("identify 1495 x 3, in the library", "s", inside("identify")),
    "images": ("identify 500 images of 88 corners, in the library", "s", inside("images")),
    "poses": ("identify and diagnose 10 000 poses of 3 markers", "s", inside("poses")),
    "poses-mb": ("their memory", "MB", inside("poses_mb")),
    "filmed": ("identify and diagnose 5 000 images of 88 corners", "s", inside("filmed")),
    "filmed-mb": ("their memory", "MB", inside("filmed_mb")),
    "refits": ("1000 refits of 15 poses, in the library", "s", inside("refits")),
    "workers": ("their gain by two workers", "x", inside("two_workers")),
    "readings": ("identify 12 000 readings of one marker", "s", readings(12_000)),
    "readings-x": (
        "100 000 of them over 12 000",
        "x",
        ratio(readings(100_000), readings(12_000)),
    ),
    "demo": ("posecal demo", "s", command("demo", "demo")),
}
"""By name: what is measured, its unit, and how."""


def row(name: str, repeats: int) -> Row:
    """Figures of one speed."""
    says, unit, measure = SPEEDS[name]
    found = measure(repeats)
    return {
        "what": says,
        "unit": unit,
        "median": statistics.median(found),
        "least": min(found),
        "most": max(found),
    }


@bench(
    click.option(
        "--only", "names", multiple=True, type=click.Choice(list(SPEEDS)), help="These alone."
    ),
    count("--repeats", 5),
    click.option("--inside", "own", type=click.Choice(list(LIBRARY)), hidden=True),
)
def main(names: tuple[str, ...], repeats: int, own: str | None, seed: int) -> Output:
    """Measure every speed; some minutes."""
    del seed
    if own is not None:
        return [json.dumps(LIBRARY[own](repeats))], None
    load = os.getloadavg()
    with TemporaryDirectory() as folder:
        os.environ.setdefault("PYTHONPYCACHEPREFIX", folder)
        os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
        rows = [row(name, repeats) for name in names or SPEEDS]
    head = f"{repeats} runs each; {os.cpu_count()} processors, load {load[0]:.1f} before\n"
    return [head, table(rows)], {"cores": os.cpu_count(), "load": list(load), "rows": rows}


if __name__ == "__main__":
    main()
