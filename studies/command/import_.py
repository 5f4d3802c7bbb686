"""``posecal import``: points and joints joined into one table, or recordings of joints as one."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click

from studies.command import options
from studies.command.call import Call

if TYPE_CHECKING:
    from calib.files.csv_table import CsvTable

_OF_PLANS = ("order", "level", "weight")  # columns that say nothing of a reading
_SHOWN = 5  # names in one line


# fmt: off
@click.command("import")
@click.argument("given", metavar="POINTS|BAG..", type=options.PATH, nargs=-1, required=True)
@options.value("--joints joints_path", "FILE", "Joints of each pose of POINTS: pose,A1_deg,..")
@options.value(
    "-o --output table_path", "TABLE", "Write the joined table to this file.", required=True
)
@options.value("--session", "NAME", "Of a bag: name of the run, in place of the bag's.", str)
@options.value("--topic", "NAME", "Of bags: where they have several topics of joints.", str)
@options.value("--slides", "A,B", "Of bags: joints that slide.", str, default="")
@options.choice("--effort", ("Nm", "A"), "Of bags: what the effort is, torques or currents.")
@options.result(figures=False, seed=False)
def import_(
    call: Call, given: tuple[Path, ...], joints_path: Path | None, table_path: Path,
    session: str | None, topic: str | None, slides: str, effort: Literal["Nm", "A"],
) -> None:
    """Join a table of measured points with a table of the joints of their poses, or read bags.

    POINTS is a CSV with the columns pose, marker and x_mm, y_mm, z_mm (or what else an instrument
    reads). The poses must have the same names in both files.

    The order of the joint file is taken as the order of measurement.

    BAG is a recording of ROS 2 (its folder, db3 or mcap) with sensor_msgs/JointState: a run of motions.

    \b
    Example:
      posecal import points.csv --joints joints.csv -o measurements.csv
      posecal import monday tuesday -o motion.csv
    """
    from calib.errors import InputError
    from calib.files.csv_table import csv_text
    from studies.results.written import ImportResult

    points = given[0]
    if points.is_dir() or points.suffix in (".db3", ".mcap"):
        _import_bags(call, given, table_path, session, topic, slides, effort)
        return
    if joints_path is None or len(given) > 1:
        what = "is one table of points, which needs --joints"
        raise InputError(points, "", what, "add it, or name folders of bags")
    inputs = [points, joints_path]
    call.check(inputs, table_path)
    columns, rows, joint_columns = joined(points, joints_path)
    result = ImportResult(
        **call.envelope("", inputs),
        poses=len({row[0] for row in rows}),
        points=len(rows),
        markers=dict(Counter(row[1] for row in rows)),
        columns=tuple(columns),
        joint_columns=tuple(joint_columns),
    )
    call.deliver(result, {table_path: csv_text(columns, rows)})


# fmt: on
def _import_bags(
    call: Call,
    bags: tuple[Path, ...],
    table_path: Path,
    session: str | None,
    topic: str | None,
    slides: str,
    effort: Literal["Nm", "A"],
) -> None:
    """Read recordings of joints as one table of motions."""
    from calib.errors import InputError
    from calib.files.bag import files_of, motion_columns, read_bag
    from calib.files.csv_table import csv_text
    from studies.results.written import ImportResult

    if session is not None and len(bags) > 1:
        raise InputError("--session", "", "names one run", "leave it out, or import one bag")
    inputs = [file for bag in bags for file in files_of(bag)]
    call.check(inputs, table_path)
    read = [read_bag(bag, topic) for bag in bags]
    for own in read:
        if own.joints != read[0].joints:
            what = f"its joints are not those of {read[0].path}"
            raise InputError(own.path, "", what, "import each robot by itself")
    columns = motion_columns(read[0].joints, slides.split(",") if slides else [], effort)
    rows = [[session or own.name, *line] for own in read for line in own.lines]
    result = ImportResult(
        **call.envelope("", inputs), warnings=tuple(text for own in read for text in own.warnings),
        poses=0, points=len(rows), markers={}, columns=tuple(columns),
        runs={session or own.name: len(own.lines) for own in read}, joint_columns=read[0].joints,
    )  # fmt: skip
    call.deliver(result, {table_path: csv_text(columns, rows)})


def joined(points_path: Path, joints_path: Path) -> tuple[list[str], list[list[str]], list[str]]:
    """Columns and rows of measurements.csv, in the order of the joints, and the columns of joints.

    Raises InputError where a pose or a column does not stand where it should.
    """
    from calib.errors import InputError
    from calib.files.csv_table import read_table

    points = read_table(points_path, ("pose", "marker"), lambda _: None, "points")
    joints = read_table(joints_path, ("pose",), lambda _: None)
    joints.refuse_twice("pose", "give each reading its own name")
    moved = [name for name in joints.columns if name not in ("pose", *_OF_PLANS)]
    for name in moved:
        if name in points.columns:
            what = f"stands in {points_path}, too"
            raise InputError(joints_path, f"column {name}", what, "keep one of them")
    at: dict[str, list[int]] = {name: [] for name in joints.names("pose")}
    for row, name in enumerate(points.names("pose")):
        if name not in at:
            what = f"pose {name!r} is not in {joints_path}"
            raise points.fault(row, "pose", what, "add its joints there, or delete its points")
        at[name].append(row)
    bare = [name for name, rows in at.items() if not rows]
    if bare:
        shown = ", ".join(bare[:_SHOWN]) + " .." * (len(bare) > _SHOWN)
        what = f"{len(bare)} without points in {points_path}: {shown}"
        raise InputError(joints_path, "column pose", what, "delete these rows, or measure them")
    rest = [name for name in points.columns if name not in ("pose", "marker")]
    rows = [
        [name, points.text("marker")[row], *_cells(joints, k, moved), *_cells(points, row, rest)]
        for k, (name, own) in enumerate(at.items())
        for row in own
    ]
    return ["pose", "marker", *moved, *rest], rows, moved


def _cells(table: CsvTable, row: int, names: list[str]) -> list[str]:
    return [table.rows[row][table.columns.index(name)] for name in names]
