"""A plant of simulated robots through ``posecal fleet``: speed, memory, a kill, workers.

    python -m studies.research.benchmarks.fleet [--robots 1000] [--diagnose] [--once] [--json FILE]

Three runs over the same files: by several workers; by as many, killed when a third is done and started
again; by one. All results must be the same to the last byte, and nothing be computed twice. ``--once``
is the first of them alone.
"""

from __future__ import annotations

import csv
import hashlib
import json
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np
import psutil

from calib.arrays import Array
from studies.research.bench import Output, bench, count
from studies.research.benchmarks.day import ARMS, Setting, draw_day, write_day
from studies.research.withheld.tables import csv_text, shown

FAULTY = 20
"""One robot in so many has a table that cannot be read."""
KNOCKED = 25
"""The second joint of one robot in so many is off by far more than those of its type."""
_KNOCK = 8e-3  # rad or m: a tooth of a belt
_SIZE = 2e-4  # rad or m, of the type's fault
_SPREAD = 0.1  # by which its size differs from robot to robot


def write_plant(folder: Path, robots: int, *, seed: int = 0, poses: int = 24) -> None:
    """Folders ``TYPE/0001`` .. with cell, robot, targets and table; types in turn."""
    for index in range(robots):
        place = folder / list(ARMS)[index % len(ARMS)] / f"{index:05d}"
        place.mkdir(parents=True)
        write_robot(place, index, seed=seed, poses=poses)
        if index % FAULTY == FAULTY - 1:
            _spoil(place / "measurements.csv")


def write_robot(place: Path, index: int, *, seed: int, poses: int) -> None:
    """One robot; all err as the sine of their second joint, by about the same."""
    setting = Setting(list(ARMS)[index % len(ARMS)], 10e-6, 1, poses, 3)
    size = _SIZE * (1.0 + _SPREAD * np.random.default_rng([seed, index]).normal())
    knock = _KNOCK * knocked(index)
    write_day(place, draw_day(setting, index, seed, _second_joint(float(size), knock)))
    (place / "exact.csv").unlink()  # what a perfect day had read


def knocked(index: int) -> bool:
    """Whether a robot was."""
    return index % KNOCKED == KNOCKED // 3 - 1


def _second_joint(size: float, knock: float) -> Callable[[Array], Array]:
    def truth(q: Array) -> Array:
        moved = q.copy()
        moved[:, 1] += knock + size * np.sin(q[:, 1])
        return moved

    return truth


def _spoil(table: Path) -> None:
    """A reading that is no number, as a tracker writes where its beam was broken."""
    with table.open(encoding="utf-8", newline="") as stream:
        rows = list(csv.reader(stream))
    rows[3][-1] = "beam broken"
    table.write_text(csv_text(rows), encoding="utf-8")


RUN = [
    sys.executable,
    "-c",
    "from studies.cli import run; run()",
    "fleet",
    ".",
    "--json",
    "fleet.json",
]
_RESULT = "*.json"
_TICK_S = 0.2
_MB = 1e6


@dataclass(frozen=True)
class Sample:
    """Seconds since the start, results that stand, and memory [byte] of the command and its workers."""

    seconds: float
    results: int
    command: int
    workers: int


@dataclass(frozen=True)
class Run:
    """A run of the command: what it said, how it went, and its time on processors [s]."""

    status: int
    said: str
    samples: list[Sample]
    cpu_s: float

    @property
    def counts(self) -> tuple[int, int]:
        """Results written and kept, as it says."""
        found = re.search(r"(\d+) results? written beside the tables, (\d+) kept", self.said)
        return (int(found[1]), int(found[2])) if found else (0, 0)

    def memory_mb(self, low: float, high: float) -> tuple[float, float]:
        """Most of the command and of its workers while so large a share of the results stood."""
        last = self.samples[-1].results
        own = [s for s in self.samples[:-1] if low * last <= s.results < high * last]
        command = max((s.command for s in own), default=0)
        return command / _MB, max((s.workers for s in own), default=0) / _MB


def run(folder: Path, *options: str, until: Callable[[Sample], bool] = lambda _: False) -> Run:
    """The command in a folder, killed as soon as ``until`` holds."""
    own = {"cwd": folder, "stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    env = {**os.environ, "PYTHONPATH": os.pathsep.join([os.getcwd(), *sys.path])}
    begun, samples = time.monotonic(), []
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with subprocess.Popen([*RUN, *options], env=env, start_new_session=True, **own) as process:  # type: ignore[call-overload]  # noqa: S603
        while process.poll() is None:
            samples.append(_sample(process.pid, folder, time.monotonic() - begun))
            if until(samples[-1]):
                process.send_signal(signal.SIGKILL)
            time.sleep(_TICK_S)
        said = process.stdout.read()
    samples.append(Sample(time.monotonic() - begun, len(results(folder)), 0, 0))
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Run(process.returncode, said, samples, cpu)


def _sample(pid: int, folder: Path, seconds: float) -> Sample:
    count = len(results(folder))
    try:
        command = psutil.Process(pid)
        own = command.memory_info().rss
        workers = sum(child.memory_info().rss for child in command.children(recursive=True))
    except psutil.Error:  # it ended just now
        own = workers = 0
    return Sample(seconds, count, own, workers)


def results(folder: Path) -> list[Path]:
    """The results beside the tables."""
    return sorted(folder.glob(f"*/*/{_RESULT}"))


def digests(folder: Path) -> dict[str, str]:
    """Every result and the summary, by their place below the folder."""
    files = [*results(folder), folder / "fleet.json"]
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in files
        if path.exists()
    }


def measured(
    base: Path, robots: int, workers: int, seed: int, options: list[str], once: bool = False
) -> dict[str, Any]:
    """The first run, then the two others and whether all agree."""
    whole, killed, alone = (base / name for name in ("whole", "killed", "alone"))
    begun = time.monotonic()
    write_plant(whole, robots, seed=seed)
    drawn_s = time.monotonic() - begun
    for copy in () if once else (killed, alone):
        shutil.copytree(whole, copy)
    many = ["--workers", str(workers), *options]
    first = run(whole, *many)
    wanted = len(results(whole))
    summary = json.loads((whole / "fleet.json").read_text(encoding="utf-8"))
    busy = [own.seconds for own in first.samples if 0 < own.results < wanted]
    found = {
        "robots": robots,
        "workers": workers,
        "options": options,
        "simulated_s": drawn_s,
        "status": first.status,
        "results": wanted,
        "faults": robots // FAULTY,
        "seconds": first.samples[-1].seconds,
        "robots_a_minute": 60.0 * robots / first.samples[-1].seconds,
        "robots_a_minute_started": 60.0 * robots / (busy[-1] - busy[0]) if len(busy) > 1 else None,
        "processor_s_a_robot": first.cpu_s / robots,
        "memory_to_a_third_mb": first.memory_mb(0.01, 1 / 3),
        "memory_of_the_last_tenth_mb": first.memory_mb(0.9, 1.0),
        "knocked": [index for index in range(robots) if knocked(index)],
        "stand_out": sorted({int(own["robot"][-5:]) for own in summary["off"]}),
    }
    if once:
        return found
    return found | _again(whole, killed, alone, many, ["--workers", "1", *options])


def _again(
    whole: Path, killed: Path, alone: Path, many: list[str], single: list[str]
) -> dict[str, Any]:
    """A run that is killed and gone on with, and one by a single worker, beside the whole one."""
    wanted = len(results(whole))
    cut = run(killed, *many, until=lambda own: own.results >= wanted // 3)
    stood = {path: path.stat().st_mtime_ns for path in results(killed)}
    second, one = run(killed, *many), run(alone, *single)
    return {
        "status_of_the_others": [cut.status, second.status, one.status],
        "processor_s_of_one_worker": one.cpu_s,
        "seconds_of_one_worker": one.samples[-1].seconds,
        "stood_at_the_kill": len(stood),
        "second_run_written_and_kept": second.counts,
        "kept_untouched": all(p.stat().st_mtime_ns == when for p, when in stood.items()),
        "killed_same_bytes": digests(killed) == digests(whole),
        "one_worker_same_bytes": digests(alone) == digests(whole),
        "left_over": [p.name for p in killed.rglob(".posecal-*")],
    }


@bench(
    click.option("--robots", type=click.IntRange(min=6), default=1000, show_default=True),
    count("--workers", 2),
    click.option("--diagnose", "both", is_flag=True, help="Diagnose too: some seconds a robot."),
    click.option("--once", is_flag=True, help="No kill, and not by one worker."),
)
def main(robots: int, workers: int, both: bool, once: bool, seed: int) -> Output:
    """Measure ``posecal fleet``; about a second of a processor a robot and run without --diagnose."""
    options = ["--holdout", "0.3", *([] if both else ["--only", "identify"])]
    with tempfile.TemporaryDirectory() as name:
        found = measured(Path(name), robots, workers, seed, options, once)
    return [f"{key:30} {shown(value)}" for key, value in found.items()], found


if __name__ == "__main__":
    main()
