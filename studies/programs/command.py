"""``posecal program``: a plan as the skeleton of a robot program."""

from __future__ import annotations

from pathlib import Path

import click

from studies.command.deliver import check_outputs, deliver, output_file
from studies.command.options import PATH, cell_argument, result_options


@click.command()
@cell_argument
@click.argument("plan_path", metavar="PLAN", type=PATH)
@click.option("-o", "--output", "program_path", metavar="FILE", required=True,
              type=PATH,
              help="FILE.src for KUKA (KRL), FILE.script for Universal Robots (URScript), FILE.mod for "
                   "ABB (RAPID), FILE.ls for FANUC.")  # fmt: skip
@result_options(figures=False, seed=False)
def program(cell_path: Path, plan_path: Path, program_path: Path, json_path: str | None) -> None:
    """Write a plan as a robot program that stops at every pose to be measured.

    PLAN is a table of poses, from posecal design or by hand. The program is a skeleton. Read the
    notes at its head. Check zero positions and directions of rotation. The way between poses is checked
    against what the cell knows of the arm and its surroundings, and led round obstacles. Run it in T1
    first.

    \b
    Example:
      posecal program cell.toml plan.csv -o plan.src
    """
    import calib
    from calib.errors import InputError
    from calib.files.read import sha256
    from doe.constraints.self_collision import unchecked
    from doe.day.day import day_of
    from studies.programs.languages import LANGUAGES, checked_lines, plain_text, plan_stops
    from studies.programs.record import program_record
    from studies.record import envelope

    language = LANGUAGES.get(program_path.suffix.lower())
    if language is None:
        known = " or ".join(LANGUAGES)
        raise InputError(
            program_path,
            "",
            f"ends in {program_path.suffix or 'nothing'}",
            f"let it end in {known}",
        )
    cell = calib.load_cell(cell_path)
    inputs = [cell_path, *cell.robot_files, plan_path]
    check_outputs([program_path, output_file(json_path)], inputs)
    day = day_of(cell, calib.load_plan(cell, plan_path))
    stops = plan_stops(day, str(plan_path))
    made_from = envelope(cell.name, inputs, about=cell.about)
    warning = unchecked(cell)
    head = (
        *([plain_text(warning, len(warning))] if warning else []),
        f"Written by posecal {made_from['version']} from {plain_text(plan_path.name)}, "
        f"sha256 {sha256(plan_path)[:16]}",
        f"Cell {plain_text(cell.name)}, {len(day.poses)} poses",
        *checked_lines(day),
    )
    made = language(program_path.stem, cell, stops, head)
    record = program_record(day, stops, made, str(program_path), warning, made_from)
    deliver(record, json_path, files={program_path: made.text})
