"""What ``posecal import`` does: points and joints, each from its own table, joined by their poses."""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

import calib
from calib.errors import InputError
from calib.files.csv_table import CsvTable, read_table
from studies.document import Document, Section, Table, heads
from studies.record import Count, Envelope, Record

if TYPE_CHECKING:
    from calib import Cell

_OF_PLANS = ("order", "level", "weight")  # columns that say nothing of a reading
_SHOWN = 5  # names in one line


class ImportRecord(Record):
    """Points and joints as one table.

    markers : name -> points; joint_columns : what the table of joints gives
    """

    of_one_cell: ClassVar[bool] = False
    command: Literal["import"] = "import"
    poses: Count
    points: Count
    markers: dict[str, Count]
    columns: tuple[str, ...]
    joint_columns: tuple[str, ...] = ()


def joined(points_path: Path, joints_path: Path) -> tuple[CsvTable, tuple[str, ...]]:
    """The rows of measurements.csv in the order of the joints, and the columns that come from these.

    Raises InputError where a pose or a column does not stand where it should.
    """
    points = read_table(points_path, ("pose", "marker"), lambda _: None, "points")
    joints = read_table(joints_path, ("pose",), lambda _: None)
    joints.refuse_twice("pose", "give each reading its own name")
    mine = [name for name in joints.columns if name not in ("pose", *_OF_PLANS)]
    for name in mine:
        if name in points.columns:
            what = f"stands in {points_path}, too"
            raise InputError(joints_path, f"column {name}", what, "keep one of them")
    named = points.names("pose")
    at: dict[str, list[int]] = {name: [] for name in joints.names("pose")}
    for row, name in enumerate(named):
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
    first, last = _places(points, ("pose", "marker")), _places(points, rest)
    values = [[row[i] for i in _places(joints, mine)] for row in joints.rows]
    order = [(k, row) for k, rows in enumerate(at.values()) for row in rows]
    texts = [
        [points.rows[row][i] for i in first] + values[k] + [points.rows[row][i] for i in last]
        for k, row in order
    ]
    lines = [points.lines[row] for _, row in order]
    columns = ("pose", "marker", *mine, *rest)
    return CsvTable(points_path, columns, texts, lines), tuple(mine)


def _places(table: CsvTable, names: list[str] | tuple[str, ...]) -> list[int]:
    return [table.columns.index(name) for name in names]


def import_record(
    table: CsvTable, mine: tuple[str, ...], warnings: tuple[str, ...], made_from: Envelope
) -> ImportRecord:
    """The record of a table that was joined; mine : its columns from the table of joints."""
    return ImportRecord(
        **made_from,
        warnings=warnings,
        poses=len(set(table.text("pose"))),
        points=len(table.rows),
        markers=dict(Counter(table.text("marker"))),
        columns=table.columns,
        joint_columns=mine,
    )


def told(record: ImportRecord) -> Document:
    """How many points of which markers, and the columns."""
    table = Table(heads("", ""), [*_rows(record)], "What was joined", fold=False)
    return Document((), (Section("import", "Points and joints joined", (table,)),))


def _rows(record: ImportRecord) -> Iterator[tuple[str, str]]:
    yield "joined", f"{record.poses} poses, {record.points} points"
    yield "markers", ", ".join(f"{name} {count}" for name, count in record.markers.items())
    yield "joints", " ".join(record.joint_columns)


def read_back(cell: Cell, table: str, target: Path) -> tuple[str, ...]:
    """Warnings of the table as ``load_measurements`` reads it. Raises InputError naming the target."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "table.csv"
        path.write_text(table, encoding="utf-8", newline="")
        try:
            read = calib.load_measurements(cell, path)
        except InputError as error:
            where = f"as joined, {error.where}" if error.where else "as joined"
            raise InputError(target, where, error.what, error.remedy) from None
        return tuple(text.replace(str(path), str(target)) for text in read.warnings)
