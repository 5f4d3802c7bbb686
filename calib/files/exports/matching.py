"""Which pose and which marker every point is of, from the name that the operator gave it.

A pattern says how: ``{pose}::{marker}`` reads the group as the pose and the point as the marker,
``{pose}_{marker}`` both from the point's name, ``{pose}/{marker}`` the pose from the file's name;
``*`` stands for any text. Without a pattern the usual ones are tried.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from calib.errors import InputError
from calib.files.exports.joints import JointTable
from calib.files.exports.points import MeasuredPoint, PointList

USUAL = (
    "{pose}::{marker}",
    "{marker}::{pose}",
    "{pose}_{marker}",
    "{pose}-{marker}",
    "{pose}.{marker}",
    "{marker}_{pose}",
)
BY_FILE = ("{pose}/{marker}", "{marker}/{pose}")
"""Tried where the points' own names tell nothing."""

_LONGEST_NAME = 200
_PART = re.compile(r"\{pose\}|\{marker\}|\*")


@dataclass(frozen=True)
class NamePattern:
    """A pattern as expressions for the file's name and for the last parts of the point's name."""

    text: str
    file: re.Pattern[str] | None
    parts: tuple[re.Pattern[str], ...]

    @property
    def names_marker(self) -> bool:
        return "{marker}" in self.text

    @property
    def names_pose(self) -> bool:
        return "{pose}" in self.text

    def read(self, path: Path, point: MeasuredPoint) -> tuple[str, str] | None:
        """(pose, marker), "" for the one that the pattern does not name; None if it does not fit."""
        whole = (point.collection, point.group, point.point)
        names = whole[len(whole) - len(self.parts) :]
        pairs = [*zip(self.parts, names, strict=True)]
        if self.file is not None:
            pairs.append((self.file, path.stem))
        found: dict[str, str] = {}
        for expression, name in pairs:
            match = expression.fullmatch(name) if len(name) <= _LONGEST_NAME else None
            if match is None:
                return None
            found |= {key: text.strip() for key, text in match.groupdict().items()}
        if not all(found.values()):
            return None
        return found.get("pose", ""), found.get("marker", "")


def name_pattern(text: str) -> NamePattern:
    """The pattern of a text. Raises InputError where it is none."""
    for field in ("{pose}", "{marker}"):
        if text.count(field) > 1:
            raise InputError("--names", "", f"{field} stands twice in {text!r}", "name it once")
    file, slash, name = text.rpartition("/")
    parts = name.split("::")
    plain = _PART.sub("", text)
    if not _PART.search(text.replace("*", "")) or "/" in file or len(parts) > 3 or "{" in plain:
        raise InputError(
            "--names",
            "",
            f"{text!r} is no pattern of names",
            "write {pose} and {marker}, as in '{pose}::{marker}' or '{pose}_{marker}'",
        )
    return NamePattern(
        text, _expression(file) if slash else None, tuple(_expression(part) for part in parts)
    )


def _expression(part: str) -> re.Pattern[str]:
    """``{pose}`` takes as much as it can: of ``P_01_m1`` the pose is ``P_01``, the marker ``m1``."""
    out, at = "", 0
    for field in _PART.finditer(part):
        out += re.escape(part[at : field.start()])
        out += ".*" if field[0] == "*" else f"(?P<{field[0][1:-1]}>.+)"
        at = field.end()
    return re.compile(out + re.escape(part[at:]))


def rounds_of(markers: Sequence[str]) -> list[int | None]:
    """Number of the round of each point where the same markers are measured over and over.

    None for what breaks the round: a marker out of turn, or all of a last round that is cut short.

    >>> rounds_of(["a", "b", "a", "b"]), rounds_of(["a", "b", "b"])
    ([0, 0, 1, 1], [0, 0, None])
    """
    order = list(dict.fromkeys(markers))
    whole = len(markers) - len(markers) % max(len(order), 1)
    return [
        i // len(order) if marker == order[i % len(order)] and i < whole else None
        for i, marker in enumerate(markers)
    ]


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
