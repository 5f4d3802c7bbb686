"""What ``posecal import`` joined, how it is told, and that a written table can be read again."""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, TypeAlias

from pydantic import Field

import calib
from calib.errors import InputError
from calib.files.exports.join import some
from calib.files.exports.joints import UNITS
from studies.document import Document, Part, Section, Table, heads, labelled
from studies.record import Count, Entry, Envelope, From, Maybe, Record

if TYPE_CHECKING:
    from calib import Cell
    from calib.files.csv_table import CsvTable
    from calib.files.exports import Joined, JointTable, PointList
    from calib.files.exports.sightings import Sighting


class ReadList(Entry):
    """A file of readings: its columns by their roles, the unit and where it stood.

    points : how many; reads : what they are
    """

    file: Annotated[str, From("path")]
    points: Count
    reads: Literal["points", "readings"] = "points"
    columns: tuple[str, ...]
    unit: str
    unit_from: str
    ignored_columns: Annotated[tuple[str, ...], From("ignored")]


class ImageRead(Entry):
    """What an image shows.

    points : board -> how many were found; edge_px : by how much its edges are smeared
    reason : why the image does not count, empty where it does
    """

    image: str
    pose: str
    instrument: str
    points: dict[str, Count]
    edge_px: Maybe
    reason: str


class ImportRecord(Record):
    """Exports as one table, and what found no counterpart.

    names : the pattern by which names tell pose and marker; names_tried : points that each one fits
    markers, poses_without_joints : name -> points
    joint_file, joint_rows, carried_columns : of the joint values
    """

    of_one_cell: ClassVar[bool] = False
    command: Literal["import"] = "import"
    names: Annotated[str, From("pattern")]
    names_tried: Annotated[dict[str, Count], From("tried")]
    poses: Count
    points: Annotated[Count, From("rows")]
    markers: dict[str, Count]
    columns: tuple[str, ...]
    lists: tuple[ReadList, ...] = Field(min_length=1)
    joint_file: Annotated[str, From("path")] = ""
    joint_rows: Count = 0
    joints: tuple[str, ...]
    carried_columns: Annotated[tuple[str, ...], From("carried")] = ()
    ignored_joint_columns: Annotated[tuple[str, ...], From("ignored")]
    poses_without_points: Annotated[tuple[str, ...], From("without_points")]
    poses_without_joints: Annotated[dict[str, Count], From("without_joints")]
    points_left_out: Annotated[tuple[str, ...], From("strays")]
    notes: tuple[str, ...]
    images: tuple[ImageRead, ...] = ()


def import_record(
    lists: Sequence[PointList],
    joints: JointTable,
    joined: Joined,
    warnings: tuple[str, ...],
    made_from: Envelope,
    seen: Mapping[str, Sequence[Sighting]] | None = None,
    notes: Sequence[str] = (),
) -> ImportRecord:
    """The record of what was joined.

    warnings : of the table as it reads back; seen : what images show, by camera
    """
    return ImportRecord.from_result(
        joined,
        joints,
        **made_from,
        warnings=warnings,
        lists=map(_list, lists),
        joint_rows=len(joints.rows),
        notes=(*joined.notes, *notes),
        images=tuple(
            ImageRead(
                image=own.shot.name,
                pose=own.shot.pose,
                instrument=camera,
                points={board: len(ids) for board, (ids, _) in own.boards.items()},
                edge_px=own.edge,
                reason=own.reason,
            )
            for camera, every in (seen or {}).items()
            for own in every
        ),
    )


def whole_record(
    tables: Sequence[CsvTable], whole: CsvTable, warnings: tuple[str, ...], made_from: Envelope
) -> ImportRecord:
    """The record of tables that were whole already, and are one now."""
    pose = whole.columns.index("pose")
    marker = whole.columns.index("marker") if "marker" in whole.columns else None
    points = [name for name in whole.columns if name.partition("_")[0] in ("x", "y", "z")]
    joints = [n for n in whole.columns if n.rpartition("_")[2] in UNITS and n not in points]
    return ImportRecord(
        **made_from,
        warnings=warnings,
        names="as the columns say",
        names_tried={},
        poses=len({row[pose] for row in whole.rows}),
        points=len(whole.rows),
        markers={} if marker is None else dict(Counter(row[marker] for row in whole.rows)),
        columns=whole.columns,
        lists=tuple(map(_whole_list, tables)),
        joints=tuple(joints),
        ignored_joint_columns=(),
        poses_without_points=(),
        poses_without_joints={},
        points_left_out=(),
        notes=(),
    )


_COORDINATES = ("x", "y", "z", "u", "v")


def _whole_list(own: CsvTable) -> ReadList:
    units = {n.rpartition("_")[2] for n in own.columns if n.partition("_")[0] in _COORDINATES}
    return ReadList.from_result(
        own,
        points=own.rows,
        unit=", ".join(sorted(units)) or "none",
        unit_from="stated in the file",
        ignored_columns=(),
    )


def _list(own: PointList) -> ReadList:
    points = own.written[0] == "x_mm" and len(own.written) == 3
    return ReadList.from_result(own, reads="points" if points else "readings")


_SHOWN = 3  # names in one line
_LISTED = 20  # images that do not count, on a terminal

Row: TypeAlias = tuple[str, str]


def told(record: ImportRecord) -> Document:
    """The files, how they fit together, and the notes."""
    return Document((), (Section("import", "Exports joined", tuple(_parts(record))),))


def _parts(record: ImportRecord) -> Iterator[Part]:
    rows = [*_read(record), *_joined(record)]
    yield Table(_ROWS, rows, "What was read and joined", fold=False)
    bad = [(own.image, own.instrument, own.reason) for own in record.images if own.reason]
    if bad:
        yield Table(_BAD, bad, "Images that do not count", most=_LISTED, fold=False)
    yield from labelled("note", (*_left_out(record), *record.notes))


_ROWS = heads("", "")
_BAD = heads("image that does not count", "instrument", "reason")


def _read(record: ImportRecord) -> Iterator[Row]:
    for own in record.lists:
        columns = " ".join(own.columns)
        said = f"{own.points} {own.reads}, columns {columns}, unit {own.unit} ({own.unit_from})"
        yield Path(own.file).name, said
    if record.joint_file:
        carried = " ".join(record.carried_columns)
        also = f", also {carried}" if carried else ""
        said = f"{record.joint_rows} rows: {' '.join(record.joints)}{also}"
        yield Path(record.joint_file).name, said


def _joined(record: ImportRecord) -> Iterator[Row]:
    kind = record.lists[0].reads
    fits = record.names_tried.get(record.names)
    total = sum(own.points for own in record.lists)
    said = "as given" if fits is None else f"tried: fits {fits} of {total} {kind}"
    yield "names", f"{record.names} ({said})"
    yield "joined", f"{record.poses} poses, {record.points} {kind}"
    yield "markers", ", ".join(_counted(record.markers))
    if record.images:
        counts = [sum(own.points.values()) for own in record.images if not own.reason]
        said = f"{len(counts)} of {len(record.images)} count, {_span(counts)} points each"
        yield "images", said


def _counted(markers: Mapping[str, int]) -> Iterator[str]:
    """How often each marker was read; of a board how many of its points, and how often."""
    boards: dict[str, list[int]] = {}
    for name, count in markers.items():
        board, _, point = name.partition(":")
        if point:
            boards.setdefault(board, []).append(count)
        else:
            yield f"{name} {count}"
    for board, counts in boards.items():
        yield f"{len(counts)} points of {board}, {_span(counts)} times each"


def _span(counts: Sequence[int]) -> str:
    least, most = min(counts), max(counts)
    return f"{most}" if least == most else f"{least} to {most}"


def _left_out(record: ImportRecord) -> Iterator[str]:
    without, strays = record.poses_without_joints, record.points_left_out
    if record.poses_without_points:
        yield f"left out, without points: {some(record.poses_without_points)}"
    if without:
        count = sum(without.values())
        yield f"left out, {count} points without joints: {some(list(without))}"
    if strays:
        shown = ", ".join(strays[:_SHOWN])
        yield f"left out, {len(strays)} points of no pose or marker, as {shown}"
    ignored = [(own.file, own.ignored_columns) for own in record.lists]
    for file, columns in (
        *ignored,
        (record.joint_file or "the joint file", record.ignored_joint_columns),
    ):
        if columns:
            yield f"{file}: columns not read: {', '.join(columns)}"
    if any("ux" in own.columns for own in record.lists):
        yield "sigma_mm is the root mean square of Ux, Uy, Uz, taken as one standard deviation each"


def read_back(cell: Cell | None, table: str, target: Path, every_marker: bool) -> tuple[str, ...]:
    """Warnings of the table as ``load_measurements`` reads it; none where there is no cell.

    every_marker : whether each that the cell reads must be there

    Raises InputError naming the target.
    """
    if cell is None:
        return ()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "table.csv"
        path.write_text(table, encoding="utf-8", newline="")
        try:
            read = calib.load_measurements(cell, path, every_marker=every_marker)
        except InputError as error:
            where = f"as joined, {error.where}" if error.where else "as joined"
            raise InputError(target, where, error.what, error.remedy) from None
        return tuple(text.replace(str(path), str(target)) for text in read.warnings)
