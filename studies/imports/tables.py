"""Joined exports as short tables for the terminal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from calib.files.exports import Joined, JointTable, PointList
from calib.files.exports.join import some

_SHOWN = 3  # names in one line


def import_tables(
    lists: Sequence[PointList], joints: JointTable, joined: Joined
) -> Iterator[RenderableType]:
    """What was read, what was joined, and what was left out."""
    yield _summary(lists, joints, joined)
    notes = [*_left_out(lists, joints, joined), *joined.notes]
    for note in notes:
        yield Text(f"note  {note}")


def _summary(lists: Sequence[PointList], joints: JointTable, joined: Joined) -> Table:
    table = Table.grid(padding=(0, 2))
    for own in lists:
        read = f"{len(own.points)} {_read(own)}, columns {' '.join(own.columns)}"
        table.add_row(Text(own.path.name), Text(f"{read}, unit {own.unit} ({own.unit_from})"))
    carried = f", also {' '.join(joints.carried)}" if joints.carried else ""
    table.add_row(
        Text(joints.path.name), Text(f"{len(joints.rows)} rows: {' '.join(joints.joints)}{carried}")
    )
    kind = _read(lists[0])
    total = sum(len(own.points) for own in lists)
    found = joined.tried.get(joined.pattern)
    said = "as given" if found is None else f"tried: fits {found} of {total} {kind}"
    table.add_row("names", Text(f"{joined.pattern} ({said})"))
    counts = ", ".join(f"{name} {count}" for name, count in joined.markers.items())
    table.add_row("joined", Text(f"{len(joined.poses)} poses, {len(joined.rows)} {kind}"))
    table.add_row("markers", Text(counts))
    return table


def _read(own: PointList) -> str:
    return "points" if own.written[0] == "x_mm" and len(own.written) == 3 else "readings"


def _left_out(lists: Sequence[PointList], joints: JointTable, joined: Joined) -> Iterator[str]:
    if joined.without_points:
        yield f"left out, without points: {some(joined.without_points)}"
    if joined.without_joints:
        count = sum(joined.without_joints.values())
        yield f"left out, {count} points without joints: {some(list(joined.without_joints))}"
    if joined.strays:
        shown = ", ".join(joined.strays[:_SHOWN])
        yield f"left out, {len(joined.strays)} points of no pose or marker, as {shown}"
    read = [(own.path, own.ignored) for own in lists] + [(joints.path, joints.ignored)]
    for path, ignored in read:
        if ignored:
            yield f"{path}: columns not read: {', '.join(ignored)}"
    if any(own.columns.count("ux") for own in lists):
        yield "sigma_mm is the root mean square of Ux, Uy, Uz, taken as one standard deviation each"
