"""``posecal program``: a plan as the skeleton of a robot program."""

from __future__ import annotations

import re
import textwrap
from pathlib import Path
from typing import TYPE_CHECKING

import click

from studies.command import options
from studies.command.call import Call

if TYPE_CHECKING:
    from calib import Cell
    from calib.poses import Poses

MOST_AXES = {".src": 12, ".script": 6, ".mod": 12, ".ls": 9}
"""Ending of a file -> axes that its language drives; ``templates/program<ending>.j2`` writes it."""
_LINKAGE = "An arm with a linkage counts axis 3 from the horizontal, a chain from the link before."


@click.command()
@options.cell
@click.argument("plan_path", metavar="PLAN", type=options.PATH)
@options.value(
    "-o --output path",
    "FILE",
    "FILE.src for KUKA (KRL), FILE.script for Universal Robots (URScript), FILE.mod for ABB (RAPID), "
    "FILE.ls for FANUC.",
    required=True,
)
@options.result(figures=False, seed=False)
def program(call: Call, cell_path: Path, plan_path: Path, path: Path) -> None:
    """Write a plan as a robot program that stops at every pose to be measured.

    The program is a skeleton that drives from pose to pose. Read the notes at its head. The way between
    poses is not checked. Run it in T1 first.

    \b
    Example:
      posecal program cell.toml plan.csv -o plan.src
    """
    import calib
    from calib.errors import InputError
    from studies.results.written import ProgramResult

    if path.suffix.lower() not in MOST_AXES:
        what = f"ends in {path.suffix or 'nothing'}"
        raise InputError(path, "", what, f"let it end in {' or '.join(MOST_AXES)}")
    cell = calib.load_cell(cell_path)
    inputs = [cell_path, *cell.robot_files, plan_path]
    call.check(inputs, path)
    made_from = call.envelope(cell, inputs)
    plan = calib.load_plan(cell, plan_path)
    head = [
        f"Written by posecal {made_from['version']} from {plan_path.name}",
        f"Zero positions and senses of rotation are those of the {cell.robot.source}.",
        "Check them. Select tool and load data of the controller first.",
        "Nothing is checked for collisions: look at each way first, in T1.",
        f"Axes: {', '.join(cell.robot.joints)}",
    ]
    text = program_text(path.suffix.lower(), path.stem, cell, plan, str(plan_path), head)
    names, stops = tuple(map(plain_text, plan.names)), (1 + (cell.load is not None)) * len(plan)
    result = ProgramResult(**made_from, program=str(path), poses=names, stops=stops)
    call.deliver(result, {path: text})


def plain_text(text: str) -> str:
    """Letters, digits and harmless signs of a text; all else becomes ``_``, and it is cut short.

    >>> plain_text('p1"); halt()' + chr(10) + 'END')
    'p1_)_ halt()_END'
    """
    return re.sub(r"[^A-Za-z0-9 _.:,=+()@%-]", "_", text)[:75]


def program_text(
    ending: str, name: str, cell: Cell, plan: Poses, source: str, head: list[str]
) -> str:
    """The program that stops at each pose, with the cell's load twice. Raises InputError."""
    import numpy as np
    from jinja2 import Template

    from calib.errors import InputError

    robot, load, most = cell.robot, cell.load, MOST_AXES[ending]
    if not 6 <= robot.dof <= most or robot.prismatic[:6].any() or robot.couplings:
        what = f"takes six joints that turn, {most - 6} after them at most, each with a drive"
        raise InputError(ending, "", what, "drive the arm by hand to the values of the plan")
    tasks = ["measure"] if load is None else ["measure", f"hang {load.mass:g} kg, measure"]
    poses = []
    for pose, q in zip(plan.names, plan.q, strict=True):
        outside = np.abs(q - np.clip(q, *robot.limits.T)) > 1e-4  # rad or m
        for joint in np.array(robot.joints)[outside]:
            what = f"joint {joint} is beyond its limits"
            raise InputError(source, f"pose {plain_text(pose)}", what, "take the pose out")
        values = [f"{v + 0.0:.6f}" for v in np.where(robot.prismatic, 1e3 * q, np.degrees(q))]
        poses.append(
            {
                "axes": values,
                "units": ["mm" if slides else "deg" for slides in robot.prismatic],
                "named": [f"{'AE'[k > 5]}{k % 6 + 1} {v}" for k, v in enumerate(values)],
                "radians": [f"{v + 0.0:.9f}" for v in q],
                "tasks": [plain_text(f"{task} {pose}") for task in tasks],
            }
        )
    file = Path(__file__).parents[1] / "templates" / f"program{ending}.j2"
    template = Template(file.read_text(encoding="utf-8"), trim_blocks=True)
    text = template.render(
        name=re.sub(r"^(?![A-Za-z])", "p_", re.sub(r"[^A-Za-z0-9_]", "_", name))[:24],
        percent=round(100 * cell.pace.speed),
        settle=cell.pace.settle,
        head=[plain_text(line) for line in head],
        linkage=_LINKAGE,
        poses=poses,
    )
    return f"{_numbered(text) if ending == '.ls' else text}\n"


def _numbered(text: str) -> str:
    """FANUC's lines between /MN and /POS with their numbers; remarks are as wide as the pendant."""
    above, body, below = re.split(r"(?<=/MN\n)|(?=/POS\n)", text)
    lines: list[str] = []
    for own in filter(None, body.splitlines()):
        parts = [f"!{part}" for part in textwrap.wrap(own[1:], 32)] if own[0] == "!" else [own]
        lines += [part if own[0] == "J" else f"  {part}" for part in parts]
    return above + "".join(f"{n:4d}:{own} ;\n" for n, own in enumerate(lines, 1)) + below
