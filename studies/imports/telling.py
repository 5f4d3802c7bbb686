"""What an import says: what was read, what was joined, and what was left out."""

from __future__ import annotations

from collections.abc import Iterator
from operator import itemgetter
from pathlib import Path
from typing import TypeAlias

from calib.files.exports.join import some
from studies.document import Column, Document, Part, Section, Table, labelled
from studies.imports.record import ImportRecord

_SHOWN = 3  # names in one line

Row: TypeAlias = tuple[str, str]


def told(record: ImportRecord) -> Document:
    """The files, how they fit together, and the notes."""
    return Document((), (Section("import", "Exports joined", tuple(_parts(record))),))


def _parts(record: ImportRecord) -> Iterator[Part]:
    rows = [*_read(record), *_joined(record)]
    yield Table(_ROWS, rows, "What was read and joined", fold=False)
    yield from labelled("note", (*_left_out(record), *record.notes))


_ROWS: tuple[Column[Row], ...] = (Column("", itemgetter(0)), Column("", itemgetter(1)))


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
    yield "markers", ", ".join(f"{name} {count}" for name, count in record.markers.items())


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
    for file, ignored in _ignored(record):
        if ignored:
            yield f"{file}: columns not read: {', '.join(ignored)}"
    if any("ux" in own.columns for own in record.lists):
        yield "sigma_mm is the root mean square of Ux, Uy, Uz, taken as one standard deviation each"


def _ignored(record: ImportRecord) -> Iterator[tuple[str, tuple[str, ...]]]:
    for own in record.lists:
        yield own.file, own.ignored_columns
    yield record.joint_file or "the joint file", record.ignored_joint_columns
