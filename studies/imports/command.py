"""``posecal import``: exports of the instrument and the controller, joined into one table."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from studies.command.deliver import check_outputs, deliver, output_file
from studies.command.options import PATH, result_options

if TYPE_CHECKING:
    from calib import Cell
    from calib.files.exports import Eye


@click.command("import")
@click.argument("points", metavar="POINTS...", nargs=-1, required=True,
                type=PATH)  # fmt: skip
@click.option("--joints", "joints_path", metavar="FILE",
              type=PATH,
              help="Joint values of each pose: a table with a header (pose,A1_deg,..), or a list of "
                   "KUKA axis values. Without it POINTS is one whole table of pose, marker, joints and "
                   "points.")  # fmt: skip
@click.option("-o", "--output", "table_path", metavar="TABLE", required=True,
              type=PATH, help="Write the joined table to this file.")  # fmt: skip
@click.option(
    "--names",
    metavar="PATTERN",
    help="Pattern of pose and marker. '{pose}::{marker}': group and point. '{pose}_{marker}': both in "
    "the point's name. '{pose}/{marker}': the file's name. * is any text. Default: the usual patterns "
    "are tried.",
)
@click.option("--marker", metavar="NAME",
              help="The only marker or body, if the names contain only the pose.")  # fmt: skip
@click.option("--eye", type=click.Choice(("in-hand", "on-base")),
              help="Where the camera of a hand-eye file is, if the file does not say it.")  # fmt: skip
@click.option("--board", "boards", metavar="NAME", multiple=True,
              help="Find this board of the cell in images: chessboard, ChArUco or tags.")  # fmt: skip
@click.option("--topic", "topics", metavar="TOPIC", multiple=True,
              help="Images of a recording. Default: all of its images.")  # fmt: skip
@click.option(
    "--moving",
    is_flag=True,
    help="Take images of a recording while the arm moves, too. Default: one at each stop.",
)
@click.option("--page", "page_path", metavar="FILE", type=PATH,
              help="Write a page of all images to this file, with what was found in them.")  # fmt: skip
@click.option("--instrument", metavar="NAME", help="The instrument, if the cell has several.")
@click.option(
    "--unit",
    type=click.Choice(("mm", "m", "in")),
    help="Unit of points, if the file does not state it.",
)
@click.option(
    "--columns",
    metavar="ROLE,ROLE,..",
    help="Columns of point lists without a header: collection, group, point, x, y, z, ux, uy, uz, "
    "time. Use - for a column to skip.",
)
@click.option(
    "--unit-joints",
    type=click.Choice(("deg", "rad", "mm", "m")),
    help="Unit of joint columns, if their title does not state it.",
)
@click.option(
    "--joint-names",
    metavar="NAME,NAME,..",
    help="Names of the joints in the robot's file, in the order of the joint file's columns.",
)
@click.option("--by-order", is_flag=True, help="Join poses by their order, not by their names.")
@click.option(
    "--partial",
    is_flag=True,
    help="Leave out poses that are in only one file, instead of refusing them.",
)
@click.option(
    "--cell",
    "cell_path",
    metavar="CELL",
    type=PATH,
    help="Check joints and markers against this cell, and check the written table.",
)
@result_options(figures=False, seed=False)
def import_(
    points: tuple[Path, ...],
    joints_path: Path | None,
    table_path: Path,
    names: str | None,
    marker: str | None,
    eye: Eye | None,
    boards: tuple[str, ...],
    topics: tuple[str, ...],
    moving: bool,
    page_path: Path | None,
    instrument: str | None,
    unit: str | None,
    columns: str | None,
    unit_joints: str | None,
    joint_names: str | None,
    by_order: bool,
    partial: bool,
    cell_path: Path | None,
    json_path: str | None,
) -> None:
    """Join lists of measured points with the joint values of their poses.

    POINTS are one of these:

    Point lists of SpatialAnalyzer and other tracker programs: collection, group, point (or fewer
    names), X, Y, Z. A header is optional. Separators are commas, semicolons, tabs or blanks.

    Rigid bodies of OptiTrack Motive, Vicon Tracker or Nexus as CSV: one file for each pose, or one file
    whose frames the joint file names.

    Samples of easy_handeye and MoveIt as YAML or JSON; --joints takes their joint states.

    Images, or a folder of images, with --board. They are named as the poses of the joint file. Of
    several cameras give a folder for each, named as the camera.

    A recording of ROS (bag, db3, mcap) with images and joint states, with --board, without --joints.

    Whole tables with tabs, semicolons or decimal commas, without --joints; several become one.

    The order of the joint file is taken as the order of measurement.

    \b
    Examples:
      posecal import tracker.txt --joints joints.csv --cell cell.toml -o day.csv
      posecal import day.txt -o day.csv
      posecal import takes/*.csv --joints joints.csv --cell cell.toml -o day.csv
      posecal import s.yaml --joints q.yaml --eye in-hand --marker eye -o day.csv
      posecal import images --board b --joints q.csv --cell cell.toml -o day.csv
      posecal import day.mcap --board b --cell cell.toml --page seen.html -o day.csv
      posecal import camera.csv tracker.csv --cell cell.toml -o day.csv
    """
    import calib
    from calib.files.csv_table import csv_text
    from calib.files.exports import read_export, read_joints
    from calib.files.exports.join import join
    from studies.imports.images import BoardImport
    from studies.imports.record import import_record, read_back
    from studies.record import envelope

    cell = None if cell_path is None else calib.load_cell(cell_path)
    files = list(points)
    if joints_path is None and not boards:
        _import_whole(files, table_path, cell, json_path)
        return
    rename = None if joint_names is None else [name.strip() for name in joint_names.split(",")]
    robot = None if cell is None else cell.robot
    joints = (
        None
        if joints_path is None
        else read_joints(joints_path, unit=unit_joints, rename=rename, robot=robot)
    )
    if joints is None or boards:
        wanted = BoardImport(files, boards, cell, joints, instrument, by_order, partial)
        outputs = [table_path, output_file(json_path), page_path]
        record, texts = wanted.run(table_path, outputs, page_path, topics, moving)
        deliver(record, json_path, files=texts)
        return
    inputs = [*files, joints.path, *([] if cell is None else [cell.path, *cell.robot_files])]
    check_outputs([table_path, output_file(json_path)], inputs)
    alone, roles = _only_body(cell), _columns(columns)
    lists = [read_export(path, unit, roles, marker, eye, alone) for path in files]
    joined = join(
        lists,
        joints,
        names=names,
        marker=None if lists[0].names else marker,
        by_order=by_order,
        partial=partial,
        markers=None if cell is None else cell.read_names,
        instrument=instrument,
    )
    table = csv_text(joined.columns, joined.rows)
    every = cell is not None and len(cell.instruments) == 1 and not partial
    warnings = read_back(cell, table, table_path, every)
    made_from = envelope("" if cell is None else cell.name, inputs)
    record = import_record(lists, joints, joined, warnings, made_from)
    deliver(record, json_path, files={table_path: table})


def _import_whole(
    files: list[Path], table_path: Path, cell: Cell | None, json_path: str | None
) -> None:
    """Write whole tables anew as one, as ``measurements.csv`` is written. Raises InputError."""
    from calib.files.csv_table import csv_text
    from calib.files.exports.joints import one_table, read_whole
    from studies.imports.record import read_back, whole_record
    from studies.record import envelope

    inputs = [*files, *([] if cell is None else [cell.path, *cell.robot_files])]
    check_outputs([table_path, output_file(json_path)], inputs)
    tables = [read_whole(path) for path in files]
    whole = one_table(tables)
    table = csv_text(whole.columns, whole.rows)
    warnings = read_back(cell, table, table_path, True)
    made_from = envelope("" if cell is None else cell.name, inputs)
    deliver(whole_record(tables, whole, warnings, made_from), json_path, files={table_path: table})


def _only_body(cell: Cell | None) -> str | None:
    """The body that the cell reads, where it reads no other."""
    from calib.instruments import Pose

    names = [] if cell is None else cell.read_names
    alone = len(names) == 1 and cell is not None and isinstance(cell.instruments[0], Pose)
    return names[0] if alone else None


def _columns(text: str | None) -> list[str] | None:
    """The roles of --columns. Raises InputError for one that is not known."""
    from calib.errors import InputError
    from calib.files.exports.points import ROLES

    if text is None:
        return None
    roles = [role.strip().lower() for role in text.split(",")]
    for role in roles:
        if role not in (*ROLES, "-"):
            raise InputError(
                "--columns", "", f"{role!r} is not known", f"use {', '.join(ROLES)}, -"
            )
    return roles
