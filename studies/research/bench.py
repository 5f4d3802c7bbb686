"""What all measurements share: arguments, many days on some processors, tables, seconds, and the file.

A function that measures is decorated with :func:`bench`, draws its days with :func:`each`, and returns
what is printed and what ``--json`` writes.
"""

from __future__ import annotations

import functools
import os
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import nullcontext
from pathlib import Path
from typing import Any, TypeVar

import click
import numpy as np
from numpy.typing import ArrayLike
from rich.table import Table
from rich.text import Text

import calib
from calib.errors import InputError
from calib.files.write import json_text, write_files
from calib.threads import one_blas_thread
from studies.command.options import one_line_faults

T = TypeVar("T")
Row = dict[str, Any]
Option = Callable[[Any], Any]
Output = tuple[Iterable[Any], Any]
"""What is printed, one after another, and what the file holds."""

_BESIDE = Path(__file__).parents[3] / "shared" / "data"


def bench(
    *options: Option, days: int | None = None, days_help: str = "", workers: bool = False
) -> Callable[[Callable[..., Output]], click.Command]:
    """A command from a function that measures: --json and --seed, and where asked --days, --workers.

    options : further ones; days : the default of ``--days``, None without it
    """

    def command(measure: Callable[..., Output]) -> click.Command:
        @functools.wraps(measure)
        def run(json_path: Path | None, **given: Any) -> None:
            from rich.console import Console

            parts, found = measure(**given)
            console = Console(highlight=False, soft_wrap=True, markup=False, emoji=False)
            for part in parts:
                console.print(part)
            if json_path is not None:
                write_files({json_path: json_text(found)})

        path = click.Path(path_type=Path)
        shared = [count("--seed", 0, least=0)]
        shared.append(click.option("--json", "json_path", type=path, help="All figures."))
        if days is not None:
            shared.append(count("--days", days, help=days_help))
        if workers:
            shared.append(count("--workers", 1, help="Processes that share the days."))
        made = one_line_faults(run)
        for option in (*shared, *reversed(options)):
            made = option(made)
        return click.command()(made)

    return command


def count(name: str, default: int, least: int = 1, **more: Any) -> Option:
    """An option that is a whole number."""
    kind = click.IntRange(min=least)
    return click.option(name, type=kind, default=default, show_default=True, **more)


def several(name: str, values: Sequence[Any], default: Sequence[Any] = (), **more: Any) -> Option:
    """An option that may be given several times: one of some words, or any number."""
    kind = click.Choice(values) if isinstance(values[0], str) else type(values[0])
    default = tuple(default or values)
    return click.option(name, multiple=True, default=default, show_default=True, type=kind, **more)


def each(
    work: Callable[..., Any], tasks: Iterable[Sequence[Any]], workers: int = 1, **options: Any
) -> list[Any]:
    """Results of all tasks in their order, one thread of linear algebra each, progress on stderr.

    tasks : arguments of each; options : those that all have in common
    """
    tasks, results = list(tasks), []
    one = functools.partial(_one, work, options)
    bar = click.progressbar(length=len(tasks), file=sys.stderr, label=work.__name__)
    with bar, ProcessPoolExecutor(workers) if workers > 1 else nullcontext() as pool:
        for result in map(one, tasks) if pool is None else pool.map(one, tasks):
            results.append(result)
            bar.update(1)
    return results


@one_blas_thread
def _one(work: Callable[..., Any], options: Mapping[str, Any], task: Sequence[Any]) -> Any:
    return work(*task, **options)


def table(rows: Iterable[Mapping[str, Any]]) -> Table:
    """Rows under their headings; the first column and columns of words are left, figures right."""
    rows = list(rows)
    keys = list(dict.fromkeys(key for row in rows for key in row))
    lines = max((key.count("\n") for key in keys), default=0)
    texts = {key: [shown(row.get(key)) for row in rows] for key in keys}
    made = Table(box=None, pad_edge=False, header_style="bold")
    for k, (key, column) in enumerate(texts.items()):
        figures = k > 0 and all(not t or t[0].isdigit() or t[0] in "-+<>" for t in column)
        above, side = "\n" * (lines - key.count("\n")), "right" if figures else "left"
        made.add_column(Text(above + key), justify=side, overflow="fold")  # type: ignore[arg-type]
    for row in zip(*texts.values(), strict=True):
        made.add_row(*row)
    return made


def shown(value: object) -> str:
    """A cell of a table: four digits of a number, a dash where there is none."""
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def clocked(work: Callable[[], T]) -> tuple[T, float]:
    """What a call gives, and its seconds on processors."""
    begun = time.process_time()
    return work(), time.process_time() - begun


def rms(values: ArrayLike) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def rms_3d(vectors: ArrayLike) -> float:
    """3-D root mean square per point of vectors (.., 3)."""
    return rms(np.linalg.norm(vectors, axis=-1))


def data_folder(name: str = "") -> Path:
    """Where a set of real measurements is, in POSECAL_DATA or beside the project; without a name all.

    Raises InputError where it is not there.
    """
    folder = Path(os.environ.get("POSECAL_DATA", _BESIDE)) / name
    if not folder.is_dir():
        raise InputError(f"{folder}", "", "holds no real measurements; set POSECAL_DATA to theirs")
    return folder


def real_data(name: str, cell: str = "", table: str = "") -> tuple[calib.Cell, calib.Measurements]:
    """Cell and measurements of a set. Raises InputError where it is not there."""
    folder = data_folder(name)
    loaded = calib.load_cell(folder / (cell or "cell.toml"))
    return loaded, calib.load_measurements(loaded, folder / (table or "measurements.csv"))
