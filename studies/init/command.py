"""``posecal init``: a first cell and an empty table for a robot of the user's own."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, cast

import click

from studies.command.deliver import check_outputs, deliver, output_file
from studies.command.options import PATH, result_options

if TYPE_CHECKING:
    from calib.arm.robot import Convention


@click.command()
@click.argument("robot_path", metavar="ROBOT", type=PATH)
@click.option(
    "-o",
    "--output",
    "folder",
    metavar="FOLDER",
    type=PATH,
    default=Path(),
    help="Folder for cell.toml and measurements.csv. Default: the current folder.",
)
@click.option("--dh", "convention", type=click.Choice(["classic", "modified"]), default=None,
              help="ROBOT is a DH table in this convention.")  # fmt: skip
@click.option(
    "--base", metavar="NAME", default="", help="First link or body, instead of the proposed one."
)
@click.option(
    "--tip",
    "tips",
    metavar="NAME",
    multiple=True,
    help="Last link, body or site, instead of the proposed one. Of several arms: one each.",
)
@result_options(figures=False, seed=False)
def init(
    robot_path: Path,
    folder: Path,
    convention: str | None,
    base: str,
    tips: tuple[str, ...],
    json_path: str | None,
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
    from calib.files.proposal import propose
    from calib.files.write import make_folder
    from studies.init.cell_text import cell_text, table_header
    from studies.init.record import init_record
    from studies.record import envelope

    tip, *rest = tips or ("",)
    others = tuple(rest)
    found = propose(robot_path, cast("Convention | None", convention), base, tip, others)
    cell_path, table_path = folder / "cell.toml", folder / "measurements.csv"
    for path in (cell_path, table_path):
        if path.exists():
            raise InputError(path, "", "already exists", "name another folder by -o, or move it")
    make_folder(folder)
    outputs = [cell_path, table_path, output_file(json_path)]
    check_outputs(outputs, found.files)
    seen = Path(os.path.relpath(robot_path.resolve(), folder.resolve())).as_posix()
    name = found.robot.name or robot_path.stem
    texts = {cell_path: cell_text(found, seen, name), table_path: table_header(found.robot)}
    made_from = envelope(str(cell_path), found.files)
    deliver(init_record(found, name, table_path, made_from), json_path, files=texts)
