"""``posecal demo``: the whole way on the paper's robot, from an embedded cell."""

from __future__ import annotations

import functools
from pathlib import Path

import click

from studies.command.deliver import output_file
from studies.command.options import json_option, one_line_faults, seed_option
from studies.command.untyped import output_texts


@click.command(short_help="The whole way on the paper's robot, as files to edit.")
@click.argument("folder", type=click.Path(path_type=Path), default=Path("posecal-demo"))
@json_option
@seed_option
@one_line_faults
def demo(folder: Path, json_path: str | None, seed: int) -> None:
    """Go the whole way in FOLDER: plan, measure, identify, compare, diagnose, report.

    The paper's KR 270 is measured by simulation, free and with 250 kg on the tool, and has an error
    that its model lacks; another --seed hides another. Every input and result is a file to edit and
    run again.

    \b
    Example:
      posecal demo my-first-calibration
    """
    from calib.errors import InputError
    from calib.files.write import write_files
    from studies.demo.way import Way

    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(folder, "", f"cannot be made ({error.strerror})", "name another") from None
    say = functools.partial(click.echo, err=json_path == "-")
    record = Way(folder, seed, say).go()
    say(_next_steps(folder))
    if output_file(json_path) is not None or json_path == "-":
        write_files({**output_texts(json_path, record)})


def _next_steps(folder: Path) -> str:
    return f"""
In {folder}: the inputs cell.toml, kr270.urdf, table2.csv (the paper's plan), plan.csv,
measurements.csv and check.csv; the truth, which nothing else reads, in truth.json; what each command
printed and found in its .txt and .json; kr270_calibrated.urdf, better_cell.toml and report.html.

Try next:
  posecal identify {folder}/better_cell.toml {folder}/measurements.csv --holdout {folder}/check.csv
  posecal compensate {folder}/cell.toml {folder}/diagnose.json {folder}/table2.csv -o corrected.csv
  posecal program {folder}/cell.toml {folder}/plan.csv -o {folder}/plan.src"""
