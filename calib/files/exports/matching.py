"""Which pose and which marker every point is of: a given pattern of names, or the best usual one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from calib.errors import InputError
from calib.files.exports.joints import JointTable
from calib.files.exports.names import BY_FILE, USUAL, NamePattern, name_pattern, rounds_of
from calib.files.exports.points import MeasuredPoint, PointList


@dataclass(frozen=True, slots=True)
class NamedPoint:
    """A point of a file, its pose and its marker."""

    path: Path
    point: MeasuredPoint
    pose: str
    marker: str

    def fault(self, what: str, remedy: str) -> InputError:
        return InputError(self.path, f"line {self.point.line}", what, remedy)


@dataclass(frozen=True)
class Matching:
    """Points with their names under one pattern.

    tried : points that found their pose under each usual pattern, empty where one was given
    strays : points whose name does not fit, or tells a marker that the cell has not
    """

    pattern: str
    points: list[NamedPoint]
    strays: list[NamedPoint]
    tried: dict[str, int]


def matched(
    lists: Sequence[PointList],
    joints: JointTable,
    *,
    names: str | None,
    marker: str | None,
    by_order: bool,
    markers: Sequence[str] | None,
) -> Matching:
    """Read the names of all points; arguments as in :func:`calib.files.exports.join.join`.

    Raises InputError where no usual pattern finds a pose, or several do equally well.
    """
    if names is not None:
        pattern = name_pattern(names)
        _check_fields(pattern, marker, by_order)
        return _read(lists, pattern, marker, markers)
    tried: dict[str, int] = {}
    chosen: list[str] = []
    for usual in (USUAL, BY_FILE) if marker is None else (("{pose}",),):
        for text in usual:
            own = _read(lists, name_pattern(text), marker, markers)
            tried[text] = _poses_found(own, joints, by_order)
        best = max(tried[text] for text in usual)
        chosen = [text for text in usual if tried[text] == best]
        if best and len(chosen) == 1:
            return replace(_read(lists, name_pattern(chosen[0]), marker, markers), tried=tried)
        if best:
            break
    raise _undecided(lists, joints, chosen if best else [], by_order)


def _undecided(
    lists: Sequence[PointList], joints: JointTable, alike: Sequence[str], by_order: bool
) -> InputError:
    if alike:
        fault = f"names can be read as {' and as '.join(alike)} alike"
    elif by_order:
        fault = (
            f"no usual way to read the names gives the {len(joints.rows)} poses of {joints.path}"
        )
    else:
        first, pose = _whole_name(lists[0].points[0])[:80], joints.rows[0].pose[:80]
        fault = (
            f"names such as {first!r} tell no pose of {joints.path}, where the first is {pose!r}"
        )
    return InputError(
        lists[0].path,
        "",
        fault,
        "say how pose and marker stand in the names, as in --names '{pose}_{marker}'",
    )


def _poses_found(own: Matching, joints: JointTable, by_order: bool) -> int:
    if by_order:
        poses = {point.pose for point in own.points}
        return len(own.points) if len(poses) == len(joints.rows) else 0
    known = {row.pose for row in joints.rows}
    return sum(point.pose in known for point in own.points)


def _check_fields(pattern: NamePattern, marker: str | None, by_order: bool) -> None:
    if pattern.names_marker == (marker is not None):
        told = "tells" if pattern.names_marker else "does not tell"
        remedy = "leave --marker out" if pattern.names_marker else "give --marker NAME"
        raise InputError("--names", "", f"{pattern.text!r} {told} the marker", remedy)
    if not pattern.names_pose and not by_order:
        remedy = "give --by-order if the points stand in the order of the joint file"
        raise InputError("--names", "", f"{pattern.text!r} does not tell the pose", remedy)


def _read(
    lists: Sequence[PointList],
    pattern: NamePattern,
    marker: str | None,
    markers: Sequence[str] | None,
) -> Matching:
    points: list[NamedPoint] = []
    strays: list[NamedPoint] = []
    for own in lists:
        for point in own.points:
            read = pattern.read(own.path, point)
            pose, told = read or (_whole_name(point), "")
            named = NamedPoint(own.path, point, pose, told or marker or "")
            known = markers is None or named.marker in markers
            (points if read is not None and known else strays).append(named)
    if not pattern.names_pose:
        points = _in_rounds(points)
    return Matching(pattern.text, points, strays, {})


def _whole_name(point: MeasuredPoint) -> str:
    return "::".join(filter(None, (point.collection, point.group, point.point)))


def _in_rounds(points: list[NamedPoint]) -> list[NamedPoint]:
    """Poses numbered by the rounds of markers. Raises InputError where a round is broken."""
    rounds = rounds_of([own.marker for own in points])
    for own, number in zip(points, rounds, strict=True):
        if number is None:
            raise own.fault(
                f"marker {own.marker!r} breaks the round of markers that tells the poses apart",
                "name the poses in the points' names",
            )
    return [replace(own, pose=f"p{n:04d}") for own, n in zip(points, rounds, strict=True)]
