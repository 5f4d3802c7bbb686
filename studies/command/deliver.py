"""How a result reaches its reader: progress, warnings, the terminal, and files, all or none."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from studies.results.base import Result


def deliver(
    result: Result,
    json_path: str | None,
    folder: Path | None = None,
    files: Mapping[Path, str | bytes] | None = None,
    *,
    warnings: Iterable[str] = (),
    notes: Iterable[str] = (),
) -> None:
    """Warn, write the JSON, the figures and what else is to be written, and print the result.

    json_path : ``-`` for standard output; folder : of the figures, None for none
    files : further files; warnings : beside those of the result; notes : lines after all

    Raises InputError where something cannot be written; then nothing is.
    """
    from calib.files.write import write_files
    from studies.render import figures, markdown, print_markdown

    warn(tuple(dict.fromkeys((*warnings, *result.warnings))))
    text, piped = markdown(result), json_path == "-"
    texts: dict[Path, str | bytes] = {}
    if json_path is not None and not piped:
        texts[Path(json_path)] = result.dumps()
    texts |= files or {}
    if folder is not None:
        _make(folder)
        texts |= figures(result, folder)
    write_files(texts)
    if piped:
        click.echo(result.dumps(), nl=False)
    print_markdown(text, stderr=piped)
    say_written(texts, folder, json_path)
    for note in notes:
        click.echo(note, err=piped)


def _make(folder: Path) -> None:
    from calib.errors import InputError

    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(folder, "", f"cannot be made ({error.strerror})", "name another") from None


def warn(messages: tuple[str, ...]) -> None:
    """Print what a reader should know, on standard error."""
    from calib.errors import plain_line

    for message in messages:
        click.echo(f"warning: {plain_line(message)}", err=True)


def check_outputs(
    outputs: Iterable[Path | None], inputs: Iterable[Path], folder: Path | None = None
) -> None:
    """Refuse, before anything is computed, what could not be read or written in the end.

    outputs : None is not written; folder : of the figures, made where it does not exist

    Raises InputError for a missing input or folder, an output over an input, and two in one file.
    """
    from calib.errors import InputError
    from calib.files.read import check_file
    from calib.files.write import check_target

    taken = set()
    for given in inputs:
        check_file(given)
        taken.add(given.resolve())
    for path in outputs:
        if path is None:
            continue
        check_target(path)
        if path.resolve() in taken:
            raise InputError(path, "", "is already an input or another output", "name another file")
        taken.add(path.resolve())
    if folder is not None and folder.exists() and not folder.is_dir():
        raise InputError(folder, "", "cannot be made (is a file)", "name another")


def output_file(json_path: str | None) -> Path | None:
    """Where the JSON goes, None for standard output."""
    return None if json_path in (None, "-") else Path(str(json_path))


def say_written(
    written: Mapping[Path, str | bytes], folder: Path | None, json_path: str | None
) -> None:
    """Name the files, those of the figures together."""
    own = [path for path in written if path.parent != folder]
    for path in own:
        click.echo(f"wrote {path}", err=json_path == "-")
    if folder is not None:
        count = len({path.stem for path in written if path.parent == folder})
        figures = f"{count} figure{'s' * (count != 1)}"
        click.echo(
            f"wrote {figures} to {folder} as .svg",
            err=json_path == "-",
        )


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
