"""How far a long computation is, and that it goes on: on a terminal, and nowhere else."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

_SHORT = 3.0  # s: what is over by then needs no forecast


@contextmanager
def progress_bar(total: int, what: str) -> Iterator[Callable[[int], None]]:
    """A bar on a terminal's standard error, to be told how many more are done; nothing elsewhere."""
    if not sys.stderr.isatty() or not total:
        yield lambda _: None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(what, total=total)
        yield lambda done: bar.update(task, advance=done)


@contextmanager
def working(what: str, seconds: float = 0.0) -> Iterator[Callable[[str], None]]:
    """A sign on a terminal's standard error that work goes on, to be told what is done now.

    seconds : how long it may take, told where that is long
    """
    if not sys.stderr.isatty():
        yield lambda _: None
        return
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    about = f", about {_duration(seconds)}" if seconds > _SHORT else ""
    columns = SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn()
    with Progress(*columns, console=Console(stderr=True), transient=True) as sign:
        task = sign.add_task(f"{what}{about}", total=None)
        yield lambda now: sign.update(task, description=f"{what}{about}: {now}")


def _duration(seconds: float) -> str:
    """In one figure: no forecast is better."""
    return f"{seconds:.0f} s" if seconds < 90.0 else f"{seconds / 60.0:.0f} min"
