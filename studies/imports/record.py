"""What ``posecal import`` joined."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, ClassVar, Literal

from pydantic import Field

from studies.record import Count, Entry, Envelope, Record

if TYPE_CHECKING:
    from calib.files.exports import Joined, JointTable, PointList


class ReadList(Entry):
    """A file of readings: its columns by their roles, the unit and where it stood.

    points : how many; reads : what they are
    """

    file: str
    points: Count
    reads: Literal["points", "readings"] = "points"
    columns: tuple[str, ...]
    unit: str
    unit_from: str
    ignored_columns: tuple[str, ...]


class ImportRecord(Record):
    """Exports as one table, and what found no counterpart.

    names : the pattern by which names tell pose and marker; names_tried : points that each one fits
    markers, poses_without_joints : name -> points
    joint_file, joint_rows, carried_columns : of the joint values, empty in results of earlier versions
    """

    of_one_cell: ClassVar[bool] = False
    command: Literal["import"] = "import"
    names: str
    names_tried: dict[str, Count]
    poses: Count
    points: Count
    markers: dict[str, Count]
    columns: tuple[str, ...]
    lists: tuple[ReadList, ...] = Field(min_length=1)
    joint_file: str = ""
    joint_rows: Count = 0
    joints: tuple[str, ...]
    carried_columns: tuple[str, ...] = ()
    ignored_joint_columns: tuple[str, ...]
    poses_without_points: tuple[str, ...]
    poses_without_joints: dict[str, Count]
    points_left_out: tuple[str, ...]
    notes: tuple[str, ...]


def import_record(
    lists: Sequence[PointList],
    joints: JointTable,
    joined: Joined,
    warnings: tuple[str, ...],
    made_from: Envelope,
) -> ImportRecord:
    """The record of what was joined.

    warnings : of the table as it reads back
    """
    return ImportRecord(
        **made_from,
        warnings=warnings,
        names=joined.pattern,
        names_tried=joined.tried,
        poses=len(joined.poses),
        points=len(joined.rows),
        markers=joined.markers,
        columns=joined.columns,
        lists=tuple(map(_list, lists)),
        joint_file=str(joints.path),
        joint_rows=len(joints.rows),
        joints=joints.joints,
        carried_columns=joints.carried,
        ignored_joint_columns=joints.ignored,
        poses_without_points=joined.without_points,
        poses_without_joints=joined.without_joints,
        points_left_out=joined.strays,
        notes=joined.notes,
    )


def _list(own: PointList) -> ReadList:
    points = own.written[0] == "x_mm" and len(own.written) == 3
    return ReadList(
        file=str(own.path),
        points=len(own.points),
        reads="points" if points else "readings",
        columns=own.columns,
        unit=own.unit,
        unit_from=own.unit_from,
        ignored_columns=own.ignored,
    )
