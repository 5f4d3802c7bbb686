"""Sealed cases for the diagnosis: make them, let it answer, score the answers.

``make 600 --seed 1 FOLDER``, then ``run FOLDER --workers 2``, then ``score FOLDER --json score.json``.
``run FOLDER --answers NAME --command ..`` lets another program answer the same cases; ``score`` sets
all that answered side by side. ``run .. --first N`` answers only the first cases, which count then.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
from rich.console import Console

from studies.research.sealed import seal

_FOLDER = click.argument("folder", type=click.Path(path_type=Path, file_okay=False))


@click.group(help=__doc__)
def main() -> None:
    """Group of the three steps."""


@main.command()
@click.argument("count", type=click.IntRange(min=1), metavar="N")
@_FOLDER
@click.option("--seed", type=click.IntRange(min=0), required=True, help="Fresh for every check.")
@click.option("--arm-noise", is_flag=True, help="Arms that scatter from approach to approach.")
@click.option("--real-arms", is_flag=True, help="Arms as real ones are: scatter, ripple, mixtures.")
@click.option("--foreign", is_flag=True, help="Causes by formulas that no model has.")
@click.option("--instruments", is_flag=True, help="Other instruments read, and faults of these.")
def make(count: int, folder: Path, seed: int, **kinds: bool) -> None:
    """Draw N cases into a new FOLDER and commit their keys."""
    chosen = [kind for kind, given in kinds.items() if given] or ["first"]
    if len(chosen) > 1:
        named = ", ".join(f"--{kind.replace('_', '-')}" for kind in chosen)
        raise click.UsageError(f"{named}: each draws arms of its own; leave the others out")
    try:
        with click.progressbar(length=count, label="cases") as bar:
            seal.make(folder, count, seed, lambda: bar.update(1), population=chosen[0])
    except FileExistsError as error:
        raise click.ClickException(str(error)) from None
    click.echo(f"wrote {count} cases, their keys and {folder / seal.COMMITMENT}")


@main.command()
@_FOLDER
@click.option("--workers", type=click.IntRange(min=1), default=1, show_default=True)
@click.option("--limit", type=float, default=120.0, show_default=True, help="Seconds for one case.")
@click.option("--answers", "program", default=seal.DIAGNOSIS, show_default=True,
              help="Who answers; any other name needs a --command.")  # fmt: skip
@click.option("--command", help="Another program, with {cell} {data} {heldout} {answer}.")
@click.option("--first", type=click.IntRange(min=1), help="Only so many cases, in their order.")
def run(folder: Path, program: str, command: str | None, first: int | None, **more: Any) -> None:
    """Let the diagnosis, or another program, answer every case, and commit the answers."""
    if command is None and program != seal.DIAGNOSIS:
        raise click.UsageError(f"--answers {program}: nobody of that name; give --command")
    if not program.replace("-", "").replace("_", "").isalnum():
        raise click.UsageError(f"--answers {program}: use letters, digits, - and _")
    if not (folder / seal.COMMITMENT).exists():
        raise click.ClickException(f"{folder}: holds no sealed cases; make them first")
    asked = {"program": program, "command": command, "first": first, **more}
    with click.progressbar(length=len(seal.case_names(folder)[:first]), label="answers") as bar:
        runs = seal.run(folder, progress=lambda: bar.update(1), **asked)
    failed = [name for name, one in runs.items() if one["status"] != "answered"]
    click.echo(f"{len(runs) - len(failed)} answered, {len(failed)} without an answer")
    for name in failed:
        log = seal.answers_folder(folder, program) / f"{name}.log"
        click.echo(f"  {name}: {runs[name]['status']}, see {log}")


@main.command()
@_FOLDER
@click.option("--json", "json_path", type=click.Path(path_type=Path), help="Write the score.")
def score(folder: Path, json_path: Path | None) -> None:
    """Check both commitments, open the keys and score."""
    from studies.research.sealed.score import score as score_cases
    from studies.research.sealed.score import show

    try:
        result = score_cases(folder)
    except seal.BrokenSeal as error:
        raise click.ClickException(str(error)) from None
    show(Console(width=120, highlight=False), result)
    if json_path is not None:
        seal.write_json(json_path, result)


if __name__ == "__main__":
    main()
