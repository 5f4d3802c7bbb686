"""Days at the edge of sense: ``python -m studies.research.fuzz_days --days 2000 --seed 0``.

Each day draws a robot, an instrument, errors, a model and motions, many of which tell next to nothing.
The commands run on it. Each must end with status 0, or 2 and one line; no place may leave the room,
and every number is one. ``--only SEED`` runs one day and says all that its commands said.
"""

from __future__ import annotations

import tempfile
import time
from collections import Counter
from pathlib import Path

import click
import numpy as np

from studies.research.fuzz_days.day import Day, draw_day
from studies.research.fuzz_days.play import Ended, Fault, played

Played = tuple[str, Ended, Fault | None]


def one_day(seed: int, folder: Path) -> tuple[Day, list[Played]]:
    """The day of a seed, its files in a folder."""
    rng = np.random.default_rng(seed)
    day = draw_day(rng, folder)
    return day, list(played(rng, day, folder))


@click.command()
@click.option("--days", type=click.IntRange(min=1), default=2000, show_default=True)
@click.option(
    "--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of the first."
)
@click.option("--only", type=click.IntRange(min=0), help="This one, and all that it says.")
@click.option("--keep", type=click.Path(path_type=Path), help="A folder for the files of --only.")
def main(days: int, seed: int, only: int | None, keep: Path | None) -> None:
    """Run days, and list what went wrong by kind."""
    if only is not None:
        _aloud(only, keep)
        return
    began, verbs, faults = time.perf_counter(), Counter[str](), dict[str, list[int]]()
    refused = 0
    for number in range(seed, seed + days):
        with tempfile.TemporaryDirectory(prefix="posecal-day-") as name:
            day, calls = one_day(number, Path(name))
        for call, ended, fault in calls:
            verbs[call.split()[0]] += 1
            refused += ended.status == 2
            if fault is not None:
                new = fault.kind not in faults
                faults.setdefault(fault.kind, []).append(number)
                if new:
                    click.echo(f"{number}: {day.name}: {fault.kind}")
    click.echo(
        f"{days} days in {time.perf_counter() - began:.0f} s: {dict(verbs)}, {refused} refused"
    )
    click.echo(f"{sum(map(len, faults.values()))} faults of {len(faults)} kinds")
    for kind, seeds in sorted(faults.items(), key=lambda item: -len(item[1])):
        click.echo(f"{len(seeds):5d}  {kind}  seeds {', '.join(map(str, seeds[:6]))}")


def _aloud(seed: int, keep: Path | None) -> None:
    with tempfile.TemporaryDirectory(prefix="posecal-day-") as name:
        folder = Path(name) if keep is None else keep
        folder.mkdir(parents=True, exist_ok=True)
        day, calls = one_day(seed, folder)
        click.echo(f"{seed}: {day.name}, room {day.room:.1f} m")
        click.echo((folder / "cell.toml").read_text(encoding="utf-8"))
        for call, ended, fault in calls:
            click.echo(f"$ posecal {call}\n{ended.output}{ended.errors}-> {ended.status}")
            if fault is not None:
                click.echo(f"FAULT {fault.kind}\n{fault.text}")


if __name__ == "__main__":
    main()
