"""A call of a command: what it checks first, and how its result reaches its reader."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from calib import Cell
    from studies.results.base import Envelope, Result

_SHORT = 3.0  # s: what is over by then needs no forecast


@dataclass(frozen=True)
class Call:
    """Where the result of a command goes, and the seed of its random numbers.

    json_path : "-" for standard output, None for nowhere; folder : of the figures, None for none
    """

    json_path: str | None
    folder: Path | None = None
    seed: int = 0

    @property
    def json(self) -> Path | None:
        """The file that the JSON goes to."""
        return None if self.json_path in (None, "-") else Path(str(self.json_path))

    def check(self, inputs: Iterable[Path], *outputs: Path | None) -> None:
        """Refuse, before anything is computed, what could not be read or written in the end.

        outputs : beside the JSON; None is not written

        Raises InputError for a missing input or folder, an output over an input, and two in one file.
        """
        from calib.errors import InputError
        from calib.files.read import check_file
        from calib.files.write import check_target

        taken = set()
        for given in inputs:
            check_file(given)
            taken.add(given.resolve())
        for path in filter(None, (*outputs, self.json)):
            check_target(path)
            if path.resolve() in taken:
                what = "is already an input or another output"
                raise InputError(path, "", what, "name another file")
            taken.add(path.resolve())
        if self.folder is not None and self.folder.exists() and not self.folder.is_dir():
            raise InputError(self.folder, "", "cannot be made (is a file)", "name another")

    def envelope(self, cell: Cell | str, inputs: Iterable[Path]) -> Envelope:
        """What the result was made from: a cell, or its name, and files, the cell's first."""
        from studies.results.base import envelope

        if isinstance(cell, str):
            return envelope(cell, inputs, self.seed)
        return envelope(cell.name, inputs, self.seed, cell.about)

    def deliver(
        self,
        result: Result,
        files: Mapping[Path, str | bytes] | None = None,
        *,
        warnings: Iterable[str] = (),
        notes: Iterable[str] = (),
    ) -> None:
        """Warn, write the JSON, the figures and what else is to be written, and print the result.

        files : further files; warnings : beside those of the result; notes : lines after all

        Raises InputError where something cannot be written; then nothing is.
        """
        from calib.errors import plain_line
        from calib.files.write import make_folder, write_files
        from studies.render import figures, markdown, plural, print_markdown

        for warning in dict.fromkeys((*warnings, *result.warnings)):
            click.echo(f"warning: {plain_line(warning)}", err=True)
        text, piped = markdown(result), self.json_path == "-"
        texts = {**({self.json: result.to_json()} if self.json else {}), **(files or {})}
        written, drawn = [f"wrote {path}" for path in texts], dict[Path, str | bytes]()
        if self.folder is not None:
            make_folder(self.folder)
            drawn = figures(result, self.folder)
            written.append(f"wrote {plural(len(drawn), 'figure')} to {self.folder} as .svg")
        write_files(texts | drawn)
        if piped:
            click.echo(result.to_json(), nl=False)
        print_markdown(text, stderr=piped)
        for line in (*written, *notes):
            click.echo(line, err=piped)


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
    with Progress(*(() if total else own), console=Console(stderr=True), transient=True) as sign:
        task = sign.add_task(f"{what}{about}", total=total or None)
        yield lambda done: sign.update(task, advance=done)


def _duration(seconds: float) -> str:
    """In one figure: no forecast is better."""
    return f"{seconds:.0f} s" if seconds < 90.0 else f"{seconds / 60.0:.0f} min"
