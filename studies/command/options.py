"""What all commands take, and how they end on what the user can mend."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar, cast

import click

from studies.command.call import Call

F = TypeVar("F", bound=Callable[..., Any])

PATH = click.Path(path_type=Path)


def value(names: str, metavar: str, text: str, kind: Any = PATH, **more: Any) -> Callable[[F], F]:
    """An option with a value: its names with blanks between them, and its help."""
    return click.option(*names.split(), metavar=metavar, type=kind, help=text, **more)


def choice(name: str, words: tuple[str, ...], text: str) -> Callable[[F], F]:
    """An option of some words, the first by default."""
    kind = click.Choice(words)
    return click.option(name, type=kind, default=words[0], show_default=True, help=text)


cell = click.argument("cell_path", metavar="CELL", type=PATH)
data = click.argument("data_path", metavar="DATA", type=PATH)
holdout = value("--holdout", "FILE|FRACTION",
                "Held-out poses: a table, or a share of the configurations.", str)  # fmt: skip


def one_line_faults(function: F) -> F:
    """End with status 2 and one line for what the user can mend."""

    @functools.wraps(function)
    def run(*args: Any, **kwargs: Any) -> Any:
        from calib.errors import CalibError

        try:
            return function(*args, **kwargs)
        except CalibError as error:
            click.echo(f"posecal: {error}", err=True)
            raise click.exceptions.Exit(2) from None

    return cast("F", run)


def result(*, figures: bool = True, seed: bool = True) -> Callable[[F], F]:
    """What every command with a result takes, as its first argument, a Call; and how it ends.

    figures, seed : whether it draws, and whether it draws random numbers
    """

    def taken(function: F) -> F:
        @functools.wraps(function)
        def run(
            json_path: str | None, figures_path: Path | None = None, seed: int = 0, **own: Any
        ) -> None:
            function(Call(json_path, figures_path, seed), **own)

        made: Any = one_line_faults(run)
        if seed:
            kind, text = click.IntRange(min=0), "Seed of all random numbers."
            made = value("--seed", "N", text, kind, default=0, show_default=True)(made)
        text = "Write the result as JSON. Use - for standard output."
        made = value("--json json_path", "FILE", text, click.Path(allow_dash=True))(made)
        text = "Write figures as SVG."
        return cast("F", value("--figures figures_path", "FOLDER", text)(made) if figures else made)

    return taken


class Finite(click.FloatRange):
    """A number in a range, neither infinite nor NaN."""

    def convert(self, value: Any, param: Any, ctx: click.Context | None) -> float:
        number = float(super().convert(value, param, ctx))
        if not math.isfinite(number):
            self.fail(f"{number} is not a finite number.", param, ctx)
        return number


ABOVE_ZERO = Finite(min=0, min_open=True)


@contextmanager
def faults_in(
    file: Path, *, effects_of: Path | None = None, readings_of: Path | None = None
) -> Iterator[None]:
    """Name the file that a fault lies in, those of the model's effects and of the readings apart."""
    from calib import errors

    try:
        yield
    except errors.InputError:
        raise
    except errors.CalibError as error:
        where = ""
        if effects_of and isinstance(error, errors.UnknownEffect | errors.EffectCannotAct):
            file, where = effects_of, "model.effects"
        elif readings_of and isinstance(error, errors.ImplausibleData):
            file = readings_of
        raise errors.InputError(file, where, str(error)) from None


def refuse(what: str, options: Mapping[str, Any], remedy: str = "leave it out") -> None:
    """Refuse options, by their names, that are given though they do not go with what is asked."""
    from calib.errors import InputError

    for name, given in options.items():
        if given is not None and given != () and given is not False:
            raise InputError(name, "", f"does not go with {what}", remedy)


def plan_names(paths: tuple[Path, ...]) -> list[str]:
    """File names, or whole paths where names repeat."""
    names = [path.name for path in paths]
    return names if len(set(names)) == len(names) else [str(path) for path in paths]
