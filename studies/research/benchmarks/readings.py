"""What a table takes, in seconds and memory, against how many readings of one marker it has.

    python -m studies.research.benchmarks.readings [--readings 3000] .. [--kind still] .. [--json FILE]

A six-jointed arm scatters by 0.03 mm from approach to approach, the instrument by 0.01 mm. Readings
stand in four ways: at poses of their own (``own``), many of each of 40 stays, as a motion capture
writes of an arm that waits (``still``), one of each of many approaches to 40 poses (``approached``),
and half of them in one stay beside poses of their own (``reference``). Every run is a process of its
own, its imports and files included; seconds are those of the clock and of the processor, MB the most
that it held at once. The exponent is the slope of log processor seconds over log readings between one
size and the next.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import click
import numpy as np

from calib.arrays import IntArray
from studies.research.bench import Output, Row, bench, several, table
from studies.research.benchmarks.day import SIGMA, Day, Setting, draw_day, write_day
from studies.research.benchmarks.speeds import RUN

POSES = 40
_SCATTER = 30e-6  # m, 3-D RMS of the tip
_READINGS = (1000, 3000, 12_000, 100_000)
_LIMIT_S = 600.0


def own(count: int) -> tuple[IntArray, IntArray]:
    """Every reading at a pose of its own."""
    return np.arange(count), np.ones(count, dtype=int)


def still(count: int) -> tuple[IntArray, IntArray]:
    """One stay at each of the poses."""
    return np.arange(POSES), _shares(count, POSES)


def approached(count: int) -> tuple[IntArray, IntArray]:
    """Rounds over the poses, one reading a stay."""
    return np.arange(count) % POSES, np.ones(count, dtype=int)


def reference(count: int) -> tuple[IntArray, IntArray]:
    """Half of the readings in the first stay, the others at poses of their own."""
    stays = count - count // 2
    return np.arange(stays), np.append(count // 2 + 1, np.ones(stays - 1, dtype=int))


KINDS: dict[str, Callable[[int], tuple[IntArray, IntArray]]] = {
    f.__name__: f for f in (own, still, approached, reference)
}
"""How many readings -> the pose of each stay, and its readings."""


def drawn(kind: str, count: int, seed: int = 0) -> Day:
    """A day of so many readings of one marker."""
    pose, reads = KINDS[kind](count)
    day = draw_day(Setting("6R", _SCATTER, 1, int(pose.max()) + 1, 1), 0, seed)
    rng = np.random.default_rng([seed, count])
    stays = np.repeat(np.arange(len(pose)), reads)
    stood = day.approach(day.q[pose], rng)[stays]
    return replace(
        day,
        names=tuple(f"r{i}" for i in range(count)),
        q=day.q[pose][stays],
        exact=day.exact[pose][stays],
        read=stood + rng.normal(size=stood.shape) * SIGMA,
    )


def _write(folder: Path, kind: str, count: int) -> None:
    write_day(folder, drawn(kind, count))


def run(arguments: list[str], folder: Path) -> dict[str, Any]:
    """Seconds, MB and how a call of ``posecal`` ended."""
    begun = time.perf_counter()
    command = [sys.executable, "-c", RUN, *arguments]
    with open(os.devnull, "w") as nowhere:
        own = subprocess.Popen(  # noqa: S603
            ["timeout", f"{_LIMIT_S:.0f}", *command],  # noqa: S607
            stdout=nowhere, stderr=subprocess.PIPE, cwd=folder,
        )  # fmt: skip
        with own.stderr or contextlib.nullcontext() as stream:
            said = b"" if stream is None else stream.read()
        _, status, used = os.wait4(own.pid, 0)
    own.returncode = os.waitstatus_to_exitcode(status)
    unit = 1e6 if sys.platform == "darwin" else 1e6 / 1024
    return {
        "seconds": time.perf_counter() - begun,
        "cpu": used.ru_utime + used.ru_stime,
        "mb": used.ru_maxrss / unit,
        "status": own.returncode,
        "said": said.decode().strip().splitlines()[-1:],
    }


def _shares(count: int, parts: int) -> IntArray:
    return np.diff(np.linspace(0, count, parts + 1).astype(int))


@bench(
    several("--readings", _READINGS),
    several("--kind", tuple(KINDS)),
    click.option(
        "--command", "asked", type=click.Choice(["identify", "diagnose"]), default="identify"
    ),
)
def main(readings: tuple[int, ...], kind: tuple[str, ...], asked: str, seed: int) -> Output:
    """Measure every kind at every size."""
    del seed
    runs: list[Row] = []
    for own, number in product(kind, readings):
        with TemporaryDirectory() as name:
            with ProcessPoolExecutor(1) as apart:  # a process begins with what its parent held
                apart.submit(_write, Path(name), own, number).result()
            found = run([asked, "cell.toml", "measurements.csv"], Path(name))
        runs.append({"command": asked, "kind": own, "readings": number, **found})
    told = (_told(before, after) for before, after in zip([None, *runs], runs, strict=False))
    return [table(told)], {"runs": runs}


def _told(before: Row | None, run: Row) -> Row:
    exponent = None
    if before is not None and before["kind"] == run["kind"]:
        cpu, more = (float(np.log(run[key] / before[key])) for key in ("cpu", "readings"))
        exponent = cpu / more
    return {
        "readings are": run["kind"],
        "number": run["readings"],
        "seconds": f"{run['seconds']:.1f}",
        "CPU": f"{run['cpu']:.1f}",
        "MB": f"{run['mb']:.0f}",
        "exponent": exponent,
        "ended": f"{run['status']}: {' '.join(run['said'])}" if run["status"] else "",
    }


if __name__ == "__main__":
    main()
