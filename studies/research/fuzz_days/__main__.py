"""Days at the edge of sense: ``python -m studies.research.fuzz_days --days 2000 --seed 0``.

Each day draws a robot, an instrument, errors, a model and motions, many of which tell next to nothing.
The commands run on it. Each must end with status 0, or 2 and one line; no place may leave the room,
and every number is one. ``--only SEED`` runs one day and says all that its commands said.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

import click

from studies.research.bench import Output, Row, bench, each, table
from studies.research.fuzz_days.play import one_day


def faults_of(seed: int) -> list[Row]:
    """What went wrong on the day of a seed, under which kind it counts."""
    with tempfile.TemporaryDirectory(prefix="posecal-day-") as name:
        day, calls = one_day(seed, Path(name))
    faults = [fault for _, _, fault in calls if fault is not None]
    return [{"kind": fault.kind, "seed": seed, "day": day.name} for fault in faults]


@bench(
    click.option("--only", type=click.IntRange(min=0), help="This one, and all that it says."),
    click.option(
        "--keep", type=click.Path(path_type=Path), help="A folder for the files of --only."
    ),
    days=2000,
    workers=True,
)
def main(days: int, seed: int, only: int | None, keep: Path | None, workers: int) -> Output:
    """Run days from the seed on, and list what went wrong by kind."""
    if only is not None:
        return _aloud(only, keep), None
    found = [
        row
        for own in each(faults_of, ((k,) for k in range(seed, seed + days)), workers)
        for row in own
    ]
    kinds = dict.fromkeys(row["kind"] for row in found)
    told = []
    for kind in kinds:
        own = [row for row in found if row["kind"] == kind]
        told.append(
            {"days": len(own), "fault": kind, "first": f"{own[0]['seed']}: {own[0]['day']}"}
        )
    return [f"{days} days: {len(found)} faults of {len(kinds)} kinds", table(told)], found


def _aloud(seed: int, keep: Path | None) -> Iterator[str]:
    with tempfile.TemporaryDirectory(prefix="posecal-day-") as name:
        folder = Path(name) if keep is None else keep
        folder.mkdir(parents=True, exist_ok=True)
        day, calls = one_day(seed, folder)
        yield f"{seed}: {day.name}, room {day.room:.1f} m"
        yield (folder / "cell.toml").read_text(encoding="utf-8")
    for call, ended, fault in calls:
        yield f"$ posecal {call}\n{ended.output}{ended.errors}-> {ended.status}"
        if fault is not None:
            yield f"FAULT {fault.kind}\n{fault.text}"


if __name__ == "__main__":
    main()
