"""``posecal program``: a plan as the skeleton of a robot program."""

from __future__ import annotations

from pathlib import Path

import click

from studies.command.deliver import check_outputs, deliver, output_file
from studies.command.options import PATH, cell_argument, result_options


@click.command()
@cell_argument
@click.argument("plan_path", metavar="PLAN", type=PATH)
@click.option("-o", "--output", "path", metavar="FILE", required=True, type=PATH,
              help="FILE.src for KUKA (KRL), FILE.script for Universal Robots (URScript), FILE.mod for "
                   "ABB (RAPID), FILE.ls for FANUC.")  # fmt: skip
@result_options(figures=False, seed=False)
def program(cell_path: Path, plan_path: Path, path: Path, json_path: str | None) -> None:
    """Write a plan as a robot program that stops at every pose to be measured.

    The program is a skeleton that drives from pose to pose. Read the notes at its head. The way between
    poses is not checked. Run it in T1 first.

    \b
    Example:
      posecal program cell.toml plan.csv -o plan.src
    """
    import calib
    from calib.errors import InputError
    from studies.programs.record import LANGUAGES, ProgramRecord, plain_text, program_text
    from studies.record import envelope

    if path.suffix.lower() not in LANGUAGES:
        what = f"ends in {path.suffix or 'nothing'}"
        raise InputError(path, "", what, f"let it end in {' or '.join(LANGUAGES)}")
    cell = calib.load_cell(cell_path)
    inputs = [cell_path, *cell.robot_files, plan_path]
    check_outputs([path, output_file(json_path)], inputs)
    made_from, plan = (
        envelope(cell.name, inputs, about=cell.about),
        calib.load_plan(cell, plan_path),
    )
    head = [
        f"Written by posecal {made_from['version']} from {plan_path.name}",
        f"Zero positions and senses of rotation are those of the {cell.robot.source}.",
        "Check them. Select tool and load data of the controller first.",
        "Nothing is checked for collisions: look at each way first, in T1.",
        f"Axes: {', '.join(cell.robot.joints)}",
    ]
    text = program_text(path.suffix.lower(), path.stem, cell, plan, str(plan_path), head)
    names, stops = tuple(map(plain_text, plan.names)), (1 + (cell.load is not None)) * len(plan)
    record = ProgramRecord(**made_from, warnings=(), program=str(path), poses=names, stops=stops)
    deliver(record, json_path, files={path: text})
