"""All benchmarks with one call: posecal beside other programs, or its own one after another.

    python -m studies.research.benchmarks all --peers FOLDER [--repeats 3] [--out FOLDER]
    python -m studies.research.benchmarks all

With ``--peers`` every other program gets an environment of its own below FOLDER, by pip, and all are
set the same work: 100 of 700 poses of a real arm to fit, the others to predict, and information blocks
to choose from. What does not install is left out and said. Times of fits are CPU seconds of one
thread. Without ``--peers`` the quick ones of the library's own benchmarks run, and what each took is
said.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import click

from calib.errors import CalibError
from calib.files.write import json_text, write_files
from studies.command.deliver import console_for
from studies.command.options import one_line_faults
from studies.research.benchmarks import design_peers
from studies.research.benchmarks.peers.judge import (
    OWN,
    REQUIRED,
    Left,
    Row,
    environment,
    markdown,
    rows_of,
    solved,
    with_ratios,
)
from studies.research.benchmarks.peers.work import write_work
from studies.tables import number, plain_table

DRIVEN = (*OWN, "figaroh", "pybotics", "robotkinecal")  # pydex designs alone
QUICK = {  # the library's own, with arguments that keep them short
    "speeds": ["--repeats", "1"],
    "startup": ["--runs", "3"],
    "montecarlo": ["--trials", "200", "--repeats", "1", "--loop", "5"],
    "instruments": [],
    "diagnosis_speed": [],
    "design": ["--quick"],
}
LIMIT_S = 300.0  # for each of them


@click.group()
def main() -> None:
    """Benchmarks of posecal."""


@main.command("all")
@click.option("--peers", type=click.Path(path_type=Path, file_okay=False), metavar="FOLDER",
              help="Install other programs below FOLDER and set all the same work.")  # fmt: skip
@click.option("--repeats", type=click.IntRange(min=1), default=3, show_default=True,
              help="Runs of which the median counts.")  # fmt: skip
@click.option("--out", type=click.Path(path_type=Path, file_okay=False),
              help="Folder for peers.md and peers.json.  [default: that of the peers]")  # fmt: skip
@one_line_faults
def all_of_them(peers: Path | None, repeats: int, out: Path | None) -> None:
    """Run everything that ends soon."""
    if peers is None:
        own_benchmarks(print)
        return
    begun, folder = time.perf_counter(), out or peers
    folder.mkdir(parents=True, exist_ok=True)
    console = console_for(None)
    pythons = environments(peers, console.print)
    rows = identification(peers / "work", pythons, repeats, console.print)
    blocks = optimal_designs(pythons, console.print)
    found = {"seconds": time.perf_counter() - begun, "identification": rows, "design": blocks}
    text = markdown(rows) + "\n" + design_markdown(blocks)
    write_files({folder / "peers.json": json_text(found), folder / "peers.md": text})
    console.print(text)
    console.print(f"{found['seconds']:.0f} s in all; wrote {folder / 'peers.md'} and peers.json")


def environments(folder: Path, say: Callable[[str], Any]) -> dict[str, Path]:
    """An interpreter for each program that installs; a line for each that does not."""
    folder.mkdir(parents=True, exist_ok=True)
    made = {name: environment(folder, name) for name in REQUIRED}
    for left in made.values():
        if isinstance(left, Left):
            say(str(left))
    return {name: python for name, python in made.items() if isinstance(python, Path)}


def identification(
    folder: Path, pythons: dict[str, Path], repeats: int, say: Callable[[str], Any]
) -> list[Row]:
    """Rows of all that identify, times as multiples of posecal's with full geometry."""
    work = write_work(folder)
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


def optimal_designs(pythons: dict[str, Path], say: Callable[[str], Any]) -> list[Row]:
    """Rows of all that choose from information blocks."""
    found = design_peers.beside(pythons, quick=True)
    for line in found.skipped:
        say(line)
    return found.rows


def design_markdown(rows: list[Row]) -> str:
    """The table of programs that choose poses."""
    head = [
        "task",
        "program",
        "way",
        "seconds",
        "det(M)^(1/p)",
        "time [x posecal]",
        "value [x posecal]",
    ]
    lines = [head, ["---"] * len(head)]
    for row in rows:
        figures = (row.get(key) for key in head)
        lines.append([x if isinstance(x, str) else number(x) for x in figures])
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"


def own_benchmarks(say: Callable[[str], Any]) -> None:
    """The library's own, one after another, and what each took."""
    table = plain_table(("benchmark", "left"), ("wall [s]", "right"), ("ended", "left"))
    for row in own_runs(say):
        table.add_row(*row)
    console_for(None).print(table)


def own_runs(say: Callable[[str], Any]) -> Iterator[tuple[str, str, str]]:
    """Name, wall seconds and how each ended."""
    for name, arguments in QUICK.items():
        say(f"--- {name}")
        begun = time.perf_counter()
        run = [sys.executable, "-m", f"studies.research.benchmarks.{name}", *arguments]
        try:
            done = subprocess.run(run, timeout=LIMIT_S, env=dict(os.environ))  # noqa: S603
            ended = "" if not done.returncode else f"status {done.returncode}"
        except subprocess.TimeoutExpired:
            ended = f"stopped after {LIMIT_S:.0f} s"
        yield name, f"{time.perf_counter() - begun:.1f}", ended


if __name__ == "__main__":
    main()
