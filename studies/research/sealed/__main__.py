"""Sealed cases for the diagnosis: make them, let it answer, score the answers.

``make 600 --seed 1 FOLDER``, then ``run FOLDER --workers 2``, then ``score FOLDER --json score.json``.
``run .. --first N`` answers only the first cases, which count then.
"""

from __future__ import annotations

from pathlib import Path

import click
from rich.console import Console

from studies.research.sealed import seal
from studies.research.sealed.score import score as score_cases
from studies.research.sealed.score import shown

_FOLDER = click.argument("folder", type=click.Path(path_type=Path, file_okay=False))


@click.group(help=(__doc__ or "").replace("\n\n", "\n\n\b\n"))
def main() -> None:
    """Group of the three steps."""


@main.command()
@click.argument("count", type=click.IntRange(min=1), metavar="N")
@_FOLDER
@click.option("--seed", type=click.IntRange(min=0), required=True, help="Fresh for every check.")
@click.option("--arm-noise", is_flag=True, help="Arms that scatter from approach to approach.")
@click.option("--real-arms", is_flag=True, help="Arms as real ones are: scatter, ripple, mixtures.")
@click.option("--foreign", is_flag=True, help="Causes by formulas that no model has.")
def make(count: int, folder: Path, seed: int, **kinds: bool) -> None:
    """Draw N cases into a new FOLDER and commit their keys."""
    chosen = [kind for kind, given in kinds.items() if given] or ["first"]
    if len(chosen) > 1:
        named = ", ".join(f"--{kind.replace('_', '-')}" for kind in chosen)
        raise click.UsageError(f"{named}: each draws arms of its own; leave the others out")
    try:
        seal.make(folder, count, seed, chosen[0])
    except FileExistsError as error:
        raise click.ClickException(str(error)) from None
    click.echo(f"wrote {count} cases, their keys and {folder / seal.COMMITMENT}")


@main.command()
@_FOLDER
@click.option("--workers", type=click.IntRange(min=1), default=1, show_default=True)
@click.option("--limit", type=float, default=120.0, show_default=True, help="Seconds for one case.")
@click.option("--first", type=click.IntRange(min=1), help="Only so many cases, in their order.")
def run(folder: Path, workers: int, limit: float, first: int | None) -> None:
    """Let the diagnosis answer every case, and commit the answers."""
    if not (folder / seal.COMMITMENT).exists():
        raise click.ClickException(f"{folder}: holds no sealed cases; make them first")
    runs = seal.run(folder, workers=workers, limit=limit, first=first)
    failed = [name for name, one in runs.items() if one["status"] != "answered"]
    click.echo(f"{len(runs) - len(failed)} answered, {len(failed)} without an answer")
    for name in failed:
        log = seal.answer_of(folder, name).with_suffix(".log")
        click.echo(f"  {name}: {runs[name]['status']}, see {log}")


@main.command()
@_FOLDER
@click.option("--json", "json_path", type=click.Path(path_type=Path), help="Write the score.")
def score(folder: Path, json_path: Path | None) -> None:
    """Check both commitments, open the keys and score."""
    try:
        result = score_cases(folder)
    except seal.BrokenSeal as error:
        raise click.ClickException(str(error)) from None
    console = Console(width=120, highlight=False)
    for part in shown(result):
        console.print(part)
    if json_path is not None:
        seal.write_json(json_path, result)


if __name__ == "__main__":
    main()
