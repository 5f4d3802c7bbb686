"""How a result reaches its reader: progress, warnings, the terminal, and files, all or none."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from studies.results.base import Result

_SHORT = 3.0  # s: what is over by then needs no forecast


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
    from calib.errors import plain_line
    from calib.files.write import make_folder, write_files
    from studies.render import figures, markdown, plural, print_markdown

    for warning in dict.fromkeys((*warnings, *result.warnings)):
        click.echo(f"warning: {plain_line(warning)}", err=True)
    text, piped, json = markdown(result), json_path == "-", output_file(json_path)
    texts = {**({json: result.to_json()} if json else {}), **(files or {})}
    drawn: dict[Path, str | bytes] = {}
    if folder is not None:
        make_folder(folder)
        drawn = figures(result, folder)
    write_files(texts | drawn)
    if piped:
        click.echo(result.to_json(), nl=False)
    print_markdown(text, stderr=piped)
    written = [f"wrote {path}" for path in texts]
    if folder is not None:
        written.append(f"wrote {plural(len(drawn), 'figure')} to {folder} as .svg")
    for line in (*written, *notes):
        click.echo(line, err=piped)


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


@contextmanager
def working(what: str, seconds: float = 0.0, total: int = 0) -> Iterator[Callable[[int], None]]:
    """A sign on a terminal's standard error that work goes on; nothing elsewhere.

    seconds : how long it may take, stated where that is long; total : of what is counted, for a bar

    Yields what is called with the number of those just done.
    """
    if not sys.stderr.isatty():
        yield lambda _: None
        return
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    about = f", about {_duration(seconds)}" if seconds > _SHORT else ""
    own: Any = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    columns = () if total else own
    with Progress(*columns, console=Console(stderr=True), transient=True) as sign:
        task = sign.add_task(f"{what}{about}", total=total or None)
        yield lambda done: sign.update(task, advance=done)


def _duration(seconds: float) -> str:
    """In one figure: no forecast is better."""
    return f"{seconds:.0f} s" if seconds < 90.0 else f"{seconds / 60.0:.0f} min"
