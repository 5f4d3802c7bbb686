"""CPU time until ``posecal --help`` has answered, and other calls before any work.

    python -m studies.research.benchmarks.startup [--runs N] [--json FILE]

Each call is a fresh process of this interpreter. Its user and system time count, not the clock: other
work disturbs them little. The test suite checks what is imported, not how long it takes.
"""

from __future__ import annotations

import resource
import statistics
import subprocess
import sys
from pathlib import Path

import click
from rich.table import Column, Table

from studies.cli import main
from studies.command.deliver import show

LIMIT_S = 0.15
RUN = "from studies.cli import run; run()"
CALLS = [["--help"], ["--version"], ["nonsense"], *([name, "--help"] for name in main.commands)]


def cpu_time(code: str, arguments: list[str]) -> float:
    """User and system time [s] of one fresh interpreter."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    run = [sys.executable, "-c", code, *arguments]
    subprocess.run(run, capture_output=True, check=False)  # noqa: S603
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


@click.command()
@click.option("--runs", type=click.IntRange(min=1), default=20, show_default=True)
@click.option("--json", "json_path", type=click.Path(path_type=Path), help="All times.")
def startup(runs: int, json_path: Path | None) -> None:
    """Measure what a person waits for before any work."""
    from calib.files.write import json_text, write_files

    calls = [("python", "pass", []), *((" ".join(call), RUN, call) for call in CALLS)]
    times = {name: [cpu_time(code, call) for _ in range(runs)] for name, code, call in calls}
    least = {name: min(own) for name, own in times.items()}
    median = {name: statistics.median(own) for name, own in times.items()}
    table = Table(
        "call",
        Column("least", justify="right"),
        Column("median", justify="right"),
        title=f"CPU time in s, {runs} runs each; --help is to stay within {LIMIT_S}",
        title_justify="left",
        box=None,
    )
    for name in times:
        table.add_row(name, f"{least[name]:.3f}", f"{median[name]:.3f}")
    if json_path is not None:
        found = {"runs": runs, "least_s": least, "median_s": median}
        write_files({json_path: json_text(found)})
    show([table], None)


if __name__ == "__main__":
    startup()
