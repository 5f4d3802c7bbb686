"""What all commands take, and how they end on what the user can mend."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import click

P = ParamSpec("P")
T = TypeVar("T")

PATH = click.Path(path_type=Path)

cell_argument = click.argument("cell_path", metavar="CELL", type=PATH)
data_argument = click.argument("data_path", metavar="DATA", type=PATH)
holdout_option = click.option(
    "--holdout",
    metavar="FILE|FRACTION",
    help="Held-out poses: a table, or a share of the configurations.",
)
_json_option = click.option(
    "--json",
    "json_path",
    metavar="FILE",
    type=click.Path(allow_dash=True),
    help="Write the result as JSON. Use - for standard output.",
)
_figures_option = click.option(
    "--figures", "folder", metavar="FOLDER", type=PATH, help="Write figures as SVG."
)
_seed_option = click.option(
    "--seed",
    metavar="N",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="Seed of all random numbers.",
)


def choice(
    name: str, words: tuple[str, ...], text: str
) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """An option of some words, the first by default."""
    kind = click.Choice(words)
    return click.option(name, type=kind, default=words[0], show_default=True, help=text)


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


def result_options(
    *, figures: bool = True, seed: bool = True
) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """What every command with a result takes, and how it ends: --figures, --json and --seed.

    figures, seed : whether it draws, and whether it draws random numbers
    """

    def taken(function: Callable[P, T]) -> Callable[P, T]:
        made = one_line_faults(function)
        made = _json_option(_seed_option(made) if seed else made)
        return _figures_option(made) if figures else made

    return taken


class Finite(click.FloatRange):
    """A number in a range, neither infinite nor NaN."""

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        number = float(super().convert(value, param, ctx))
        if not math.isfinite(number):
            self.fail(f"{number} is not a finite number.", param, ctx)
        return number


@contextmanager
def faults_in(
    file: Path, *, effects_of: Path | None = None, readings_of: Path | None = None
) -> Iterator[None]:
    """Name the file that a fault lies in, those of the model's effects and of the readings apart."""
    from calib.errors import CalibError, EffectCannotAct, ImplausibleData, InputError, UnknownEffect

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


def plan_names(paths: tuple[Path, ...]) -> list[str]:
    """File names, or whole paths where names repeat."""
    names = [path.name for path in paths]
    return names if len(set(names)) == len(names) else [str(path) for path in paths]
