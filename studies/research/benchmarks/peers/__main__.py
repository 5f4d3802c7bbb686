"""posecal beside other programs: each in an environment of its own, all at the same work.

    python -m studies.research.benchmarks.peers FOLDER [--repeats 3] [--json FILE]

Every other program is installed below FOLDER by pip. 100 of 700 poses of a real arm are to be fitted,
the others predicted, and plans chosen from information of candidates. What does not install is left out
and said. Times of fits are CPU seconds of one thread.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from calib.errors import CalibError
from studies.research.bench import Output, Row, bench, count, table
from studies.research.benchmarks.peers import designs
from studies.research.benchmarks.peers.judge import (
    OWN,
    REQUIRED,
    Left,
    environment,
    rows_of,
    solved,
    told,
    with_ratios,
)
from studies.research.benchmarks.peers.work import Work, write_work

_PLANS = (
    "task",
    "program",
    "way",
    "seconds",
    "det(M)^(1/p)",
    "time [x posecal]",
    "value [x posecal]",
)
DRIVEN = (*OWN, "figaroh", "pybotics", "robotkinecal")  # pydex designs alone


@bench(
    click.argument("folder", type=click.Path(path_type=Path, file_okay=False)),
    count("--repeats", 3, help="Runs of which the median counts."),
)
def main(folder: Path, repeats: int, seed: int) -> Output:
    """Set posecal and other programs the same work."""
    del seed
    folder.mkdir(parents=True, exist_ok=True)
    work = write_work(folder / "work")
    pythons = environments(folder, click.echo)
    rows = identification(work, pythons, repeats, click.echo)
    compared = designs.beside(pythons)
    plans = [{key: row.get(key) for key in _PLANS} for row in compared.rows]
    shown = [table(map(told, rows)), "", table(plans), *compared.skipped]
    return shown, {"identification": rows, "design": compared.rows}


def environments(folder: Path, say: Callable[[str], Any]) -> dict[str, Path]:
    """An interpreter for each program that installs; a line for each that does not."""
    folder.mkdir(parents=True, exist_ok=True)
    made = {name: environment(folder, name) for name in REQUIRED}
    for left in made.values():
        if isinstance(left, Left):
            say(str(left))
    return {name: python for name, python in made.items() if isinstance(python, Path)}


def identification(
    work: Work, pythons: dict[str, Path], repeats: int, say: Callable[[str], Any]
) -> list[Row]:
    """Rows of all that identify, times as multiples of posecal's with full geometry."""
    run = {name: Path(sys.executable) for name in OWN} | pythons
    rows: list[Row] = []
    for name, python in run.items():
        if name not in DRIVEN:
            continue
        answer = solved(python, name, work, repeats)
        if isinstance(answer, Left):
            say(str(answer))
        else:
            rows += rows_of(name, answer, work)
    if not rows or not rows[0]["program"].startswith("posecal"):
        raise CalibError("posecal itself did not answer; see the line above")
    return with_ratios(rows, rows[0])


if __name__ == "__main__":
    main()
