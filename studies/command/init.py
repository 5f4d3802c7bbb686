"""``posecal init``: a first cell and an empty table for a robot of the user's own."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING

import click

from studies.command import options
from studies.command.call import Call

if TYPE_CHECKING:
    from calib.arm.robot import Convention
    from calib.files.robot import Proposal


# fmt: off
@click.command()
@click.argument("robot_path", metavar="ROBOT", type=options.PATH)
@options.value("-o --output folder", "FOLDER",
    "Folder for cell.toml and measurements.csv. Default: this one.", default=Path())
@options.value("--dh convention", "[classic|modified]", "ROBOT is a DH table in this convention.",
    click.Choice(["classic", "modified"]))
@options.value("--base", "NAME", "First link or body, if another.", str, default="")
@options.value("--tip tips", "NAME", "Last link, body or site, if another. Of several arms: one each.",
    str, multiple=True)
@options.result(figures=False, seed=False)
def init(
    call: Call, robot_path: Path, folder: Path, convention: Convention | None, base: str,
    tips: tuple[str, ...],
) -> None:
    """Write a commented cell.toml and an empty measurements.csv for a robot.

    ROBOT is a URDF (also as xacro writes it), an MJCF, or a DH table
    (joint,alpha_deg,a_mm,theta_deg,d_mm).

    You can plan with this cell at once. Rough marker positions and the noise are all that you give;
    their lines are marked EDIT.

    \b
    Example:
      posecal init robot.urdf -o my-cell
      posecal init pair.urdf --tip right_hand --tip left_hand -o my-cell
    """
    import os

    from calib.errors import InputError
    from calib.files.csv_table import csv_text
    from calib.files.robot import propose
    from calib.files.write import make_folder
    from calib.files.write_tables import measurement_columns
    from calib.instruments import Tracker
    from studies.results.written import InitResult

    tip, others = (tips or ("",))[0], tips[1:]
    found = propose(robot_path, convention, base, tip, others)
    cell_path, table_path = folder / "cell.toml", folder / "measurements.csv"
    for path in (cell_path, table_path):
        if path.exists():
            raise InputError(path, "", "already exists", "name another folder by -o, or move it")
    make_folder(folder)
    files = found.robot.source.files
    call.check(files, cell_path, table_path)
    beside = Path(os.path.relpath(robot_path.resolve(), folder.resolve())).as_posix()
    name = found.robot.name or robot_path.stem
    header = csv_text(measurement_columns(found.robot, (Tracker(),)), [])
    texts = {cell_path: cell_text(found, beside, name), table_path: header}
    result = InitResult.of(found, name, table_path, call.envelope(str(cell_path), files))
    following = f"then  posecal design {cell_path} -o {folder / 'plan.csv'}"
    call.deliver(result, texts, notes=[following])


# fmt: on
def cell_text(found: Proposal, robot_file: str, name: str) -> str:
    """TOML with comments, which loads as it is; robot_file : as seen from the cell."""
    import numpy as np
    from jinja2 import Environment

    from calib.arm.repeatability import usual_repeatability

    robot = found.robot
    usual = usual_repeatability(robot.reach)
    text = (Path(__file__).parents[1] / "templates" / "cell.toml.j2").read_text(encoding="utf-8")
    plain = Environment(trim_blocks=True, keep_trailing_newline=True)  # noqa: S701 - is no HTML
    plain.filters |= {"text": json.dumps, "key": key}  # escapes of JSON are those of TOML
    missing = ~np.isfinite(robot.limits).all(axis=1)
    return plain.from_string(text).render(
        robot=robot,
        form=found.robot.source.form,
        file=robot_file,
        name=name,
        usual={key: rough(1e3 * getattr(usual, key)) for key in ("best", "middle", "worst")},
        turn=rough(1e6 * usual.middle / (0.5 * robot.reach)),  # of joints, at half the arm's length
        missing={
            "limits_deg": [robot.joints[j] for j in np.flatnonzero(missing & ~robot.prismatic)],
            "limits_mm": [robot.joints[j] for j in np.flatnonzero(missing & robot.prismatic)],
        },
        size=min(max(round(robot.reach * 1e3 / 20, -1), 20), 150),  # mm, of the triangle of markers
    )


def rough(x: float) -> str:
    """One digit.

    >>> rough(0.0234)
    '0.02'
    """
    return f"{float(f'{x:.1g}'):g}"


def key(name: str) -> str:
    """A key of TOML."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else json.dumps(name)
