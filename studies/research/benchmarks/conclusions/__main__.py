"""The command: days of each part, one table a part, every day in a file."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import click
import numpy as np

from calib.files.write import json_text, write_files
from calib.threads import one_blas_thread
from studies.command.deliver import console_for
from studies.command.options import one_line_faults
from studies.research.benchmarks.conclusions.days import Row, read, said_of
from studies.research.benchmarks.conclusions.judged import judged
from studies.research.benchmarks.conclusions.parts import DRAWS, KINDS
from studies.research.benchmarks.conclusions.sizing import NoSuchDay
from studies.research.benchmarks.conclusions.tables import calibration_table, table_of


@one_blas_thread
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


def all_days(part: str, numbers: Sequence[int], seed: int, workers: int) -> list[Row]:
    """Every day, in order."""
    work = partial(one_day, part, seed=seed)
    if workers == 1:
        return list(map(work, numbers))
    with ProcessPoolExecutor(workers) as pool:
        return list(pool.map(work, numbers))


@click.command()
@click.argument("parts", nargs=-1, type=click.Choice(list(DRAWS)))
@click.option("--days", type=click.IntRange(min=1), default=40, show_default=True,
              help="Of each part; of part hard, and with --kind, of each kind.")  # fmt: skip
@click.option("--kind", "kinds", multiple=True, help="Of parts foreign and hard, only these.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True)
@click.option("--workers", type=click.IntRange(min=1), default=1, show_default=True)
@click.option("--json", "json_path", type=click.Path(path_type=Path), help="Every day.")
@one_line_faults
def main(
    parts: tuple[str, ...],
    days: int,
    kinds: tuple[str, ...],
    seed: int,
    workers: int,
    json_path: Path | None,
) -> None:
    """Count how often the conclusions of the diagnosis come true."""
    console, found = console_for(None), list[Row]()
    for part in parts or DRAWS:
        rows = all_days(part, numbers_of(part, days, kinds), seed, workers)
        console.print(table_of(part, rows))
        console.print(calibration_table(rows))
        console.print(f"{np.mean([r['seconds'] for r in rows]):.1f} s a day\n")
        found += rows
    if json_path is not None:
        write_files({json_path: json_text({"seed": seed, "days": found})})


if __name__ == "__main__":
    main()
