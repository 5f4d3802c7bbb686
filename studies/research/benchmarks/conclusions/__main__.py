"""The command: days of each part, one table a part, every day in a file."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from typing import Any

import click
import numpy as np

from studies.research.bench import Output, bench, each
from studies.research.benchmarks.conclusions.days import NoSuchDay, Row, read, said_of
from studies.research.benchmarks.conclusions.judged import calibration_table, judged, table_of
from studies.research.benchmarks.conclusions.parts import DRAWS, KINDS


def one_day(part: str, index: int, seed: int) -> Row:
    """Draw a day by its number, ask, and judge."""
    rng = np.random.default_rng([seed, zlib.crc32(part.encode()), index])
    while True:
        day = DRAWS[part](rng, index)
        try:
            case = read(rng, day)
            break
        except NoSuchDay:
            continue
    return {"part": part, "day": index, "seed": seed, **judged(day, said_of(case))}


def numbers_of(part: str, days: int, kinds: Sequence[str] = ()) -> list[int]:
    """Numbers of the days of a part: so many of all, or of each of some kinds."""
    known = KINDS.get(part, ())
    wanted = [k for k in kinds if k in known] or (known if part == "hard" else ())
    if not wanted:
        return list(range(days))
    return sorted(known.index(k) + len(known) * i for k in wanted for i in range(days))


@bench(
    click.argument("parts", nargs=-1, type=click.Choice(list(DRAWS))),
    click.option("--kind", "kinds", multiple=True, help="Of parts foreign and hard, only these."),
    days=40,
    days_help="Of each part; of part hard, and with --kind, of each kind.",
    workers=True,
)
def main(
    parts: tuple[str, ...], days: int, kinds: tuple[str, ...], seed: int, workers: int
) -> Output:
    """Count how often the conclusions of the diagnosis come true."""
    shown, found = list[Any](), list[Row]()
    for part in parts or DRAWS:
        tasks = [(part, number) for number in numbers_of(part, days, kinds)]
        rows = each(one_day, tasks, workers, seed=seed)
        seconds = np.mean([r["seconds"] for r in rows])
        shown += [table_of(part, rows), calibration_table(rows), f"{seconds:.1f} s a day\n"]
        found += rows
    return shown, {"seed": seed, "days": found}


if __name__ == "__main__":
    main()
