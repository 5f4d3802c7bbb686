"""What all commands share: fault lines, provenance, output."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

import click

if TYPE_CHECKING:
    from rich.console import Console

    from studies.plots.style import Picture

P = ParamSpec("P")
T = TypeVar("T")

_WIDTH = 120  # of tables in files and pipes

PATH = click.Path(path_type=Path)

cell_argument = click.argument("cell_path", metavar="CELL", type=PATH)
data_argument = click.argument("data_path", metavar="DATA", type=PATH)
json_option = click.option(
    "--json",
    "json_path",
    metavar="FILE",
    type=click.Path(allow_dash=True),
    help="Write the result as JSON; - for standard output.",
)
figures_option = click.option(
    "--figures",
    "folder",
    metavar="FOLDER",
    type=PATH,
    help="Write the figures, as SVG and PNG, with their numbers as CSV.",
)
seed_option = click.option(
    "--seed",
    metavar="N",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="Seed of everything that is drawn by chance.",
)


def one_line_faults(function: Callable[P, T]) -> Callable[P, T]:
    """End with status 2 and one line for what the user can mend."""

    @functools.wraps(function)
    def run(*args: P.args, **kwargs: P.kwargs) -> T:
        from calib.errors import CalibError

        try:
            return function(*args, **kwargs)
        except CalibError as error:
            click.echo(f"posecal: {error}", err=True)
            raise click.exceptions.Exit(2) from None

    return run


def result_options(function: Callable[P, T]) -> Callable[P, T]:
    """What every command with a result takes, and how it ends: --figures, --json and --seed."""
    return figures_option(json_option(seed_option(one_line_faults(function))))


@contextmanager
def faults_in(
    file: Path, *, effects_of: Path | None = None, readings_of: Path | None = None
) -> Iterator[None]:
    """Name the file that a fault lies in, those of the model's effects and of the readings apart."""
    from calib.errors import (
        CalibError,
        EffectCannotAct,
        ImplausibleData,
        InputError,
        UnknownEffect,
    )

    try:
        yield
    except InputError:
        raise
    except CalibError as error:
        if effects_of is not None and isinstance(error, UnknownEffect | EffectCannotAct):
            raise InputError(effects_of, "model.effects", str(error)) from None
        if readings_of is not None and isinstance(error, ImplausibleData):
            raise InputError(readings_of, "", str(error)) from None
        raise InputError(file, "", str(error)) from None


def envelope(command: str, inputs: list[Path], seed: int) -> dict[str, Any]:
    """Fields that every result carries."""
    from importlib.metadata import version

    from calib.files.read import sha256

    return {
        "schema": 1,
        "command": command,
        "version": version("posecal"),
        "seed": seed,
        "inputs": [{"file": str(path), "sha256": sha256(path)} for path in inputs],
    }


def console_for(json_path: str | None) -> Console:
    """Where tables go: standard output, or standard error when that carries the JSON."""
    from rich.console import Console

    # Names are the user's: brackets and colons in them are no markup.
    console = Console(
        stderr=json_path == "-", highlight=False, soft_wrap=True, markup=False, emoji=False
    )
    if not console.is_terminal:
        console.width = _WIDTH
    return console


def show(parts: Iterable[Any], json_path: str | None) -> None:
    """Print tables where they go."""
    console = console_for(json_path)
    for part in parts:
        console.print(part)


def warn(messages: tuple[str, ...]) -> None:
    """Print what a reader should know, on standard error."""
    from calib.errors import plain_line

    for message in messages:
        click.echo(f"warning: {plain_line(message)}", err=True)


class Finite(click.FloatRange):
    """A number in a range, neither infinite nor NaN."""

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        number = float(super().convert(value, param, ctx))
        if not math.isfinite(number):
            self.fail(f"{number} is not a finite number.", param, ctx)
        return number


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


def plan_names(paths: tuple[Path, ...]) -> list[str]:
    """File names, or whole paths where names repeat."""
    names = [path.name for path in paths]
    return names if len(set(names)) == len(names) else [str(path) for path in paths]


def output_file(json_path: str | None) -> Path | None:
    """Where the JSON goes, None for standard output."""
    return None if json_path in (None, "-") else Path(str(json_path))


def output_texts(json_path: str | None, result: dict[str, Any]) -> dict[Path, str]:
    """The JSON as a file to write; with ``-`` it goes to standard output at once."""
    from calib.files.write import json_text

    if json_path is None:
        return {}
    if json_path == "-":
        click.echo(json_text(result), nl=False)
        return {}
    return {Path(json_path): json_text(result)}


def figure_files(pictures: Iterable[Picture], folder: Path) -> dict[Path, str | bytes]:
    """The files of figures in a folder, which is made. Raises InputError."""
    from calib.errors import InputError
    from studies.plots.style import folder_files

    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(folder, "", f"cannot be made ({error.strerror})", "name another") from None
    return folder_files(pictures, folder)


def say_written(
    written: Mapping[Path, str | bytes], folder: Path | None, json_path: str | None
) -> None:
    """Name the files, those of the figures together."""
    own = [path for path in written if path.parent != folder]
    for path in own:
        click.echo(f"wrote {path}", err=json_path == "-")
    if folder is not None:
        count = len({path.stem for path in written if path.parent == folder})
        click.echo(
            f"wrote {count} figure{'s' * (count != 1)} to {folder} as .svg and .png, with their "
            "numbers as .csv",
            err=json_path == "-",
        )
