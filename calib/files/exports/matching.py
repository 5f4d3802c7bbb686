"""Which pose and which marker every point is of, from the name that the operator gave it.

A pattern says how: ``{pose}::{marker}`` reads the group as the pose and the point as the marker,
``{pose}_{marker}`` both from the point's name, ``{pose}/{marker}`` the pose from the file's name;
``*`` stands for any text. Without a pattern the usual ones are tried.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

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

    def read(self, point: MeasuredPoint) -> tuple[str, str] | None:
        """(pose, marker), "" for the one that the pattern does not name; None if it does not fit."""
        whole = (point.collection, point.group, point.point)
        names = whole[len(whole) - len(self.parts) :]
        pairs = [*zip(self.parts, names, strict=True)]
        if self.file is not None:
            pairs.append((self.file, point.path.stem))
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
        remedy = "write {pose} and {marker}, as in '{pose}::{marker}' or '{pose}_{marker}'"
        raise InputError("--names", "", f"{text!r} is no pattern of names", remedy)
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


@dataclass(frozen=True)
class Matching:
    """Points with their names under one pattern.

    tried : points that found their pose under each usual pattern, empty where one was given
    strays : points whose name does not fit, or tells a marker that the cell has not
    """

    pattern: str
    points: list[MeasuredPoint]
    strays: list[MeasuredPoint]
    tried: dict[str, int]


@dataclass(frozen=True)
class Exports:
    """Lists of readings and the joint file of their poses, and what the user says of them.

    marker : the only marker, where names tell only the pose
    by_order : the k-th pose of the lists stands in the k-th row of the joint file
    markers : the ones that the cell knows
    """

    lists: Sequence[PointList]
    joints: JointTable
    marker: str | None
    by_order: bool
    markers: Sequence[str] | None

    def matched(self, names: str | None) -> Matching:
        """Read the names of all points by a pattern, or by the usual one that finds most poses.

        Raises InputError where no usual pattern finds a pose, or several do equally well.
        """
        if names is not None:
            pattern = name_pattern(names)
            self._check_fields(pattern)
            return self._read(pattern)
        tried: dict[str, int] = {}
        alike: list[str] = []
        for usual in (USUAL, BY_FILE) if self.marker is None else (("{pose}",),):
            found = {text: self._read(name_pattern(text)) for text in usual}
            tried |= {text: self._poses_found(own) for text, own in found.items()}
            best = max(tried[text] for text in usual)
            alike = [text for text in usual if tried[text] == best] if best else []
            if len(alike) == 1:
                return replace(found[alike[0]], tried=tried)
            if alike:
                break
        raise self._undecided(alike)

    def _undecided(self, alike: Sequence[str]) -> InputError:
        count, file = len(self.joints.rows), self.joints.path
        if alike:
            what = f"names can be read as {' and as '.join(alike)} alike"
        elif self.by_order:
            what = f"no usual way to read the names gives the {count} poses of {file}"
        else:
            first, pose = self.lists[0].points[0].whole_name, self.joints.rows[0].pose
            what = (
                f"names such as {first[:80]!r} tell no pose of {file}, where the first is "
                f"{pose[:80]!r}"
            )
        remedy = "say how pose and marker stand in the names, as in --names '{pose}_{marker}'"
        return InputError(self.lists[0].path, "", what, remedy)

    def _poses_found(self, own: Matching) -> int:
        """Points whose pose the joint file has."""
        if self.by_order:
            poses = {point.pose for point in own.points}
            return len(own.points) if len(poses) == len(self.joints.rows) else 0
        known = {row.pose for row in self.joints.rows}
        return sum(point.pose in known for point in own.points)

    def _check_fields(self, pattern: NamePattern) -> None:
        told = "{marker}" in pattern.text
        if told == (self.marker is not None):
            what = f"{pattern.text!r} {'tells' if told else 'does not tell'} the marker"
            remedy = "leave --marker out" if told else "give --marker NAME"
            raise InputError("--names", "", what, remedy)
        if "{pose}" not in pattern.text and not self.by_order:
            what = f"{pattern.text!r} does not tell the pose"
            remedy = "give --by-order if the points stand in the order of the joint file"
            raise InputError("--names", "", what, remedy)

    def _read(self, pattern: NamePattern) -> Matching:
        points: list[MeasuredPoint] = []
        strays: list[MeasuredPoint] = []
        for point in (point for own in self.lists for point in own.points):
            read = pattern.read(point)
            pose, told = read or (point.whole_name, "")
            named = replace(point, pose=pose, marker=told or self.marker or "")
            known = self.markers is None or named.marker in self.markers
            (points if read is not None and known else strays).append(named)
        if "{pose}" not in pattern.text:
            points = _in_rounds(points)
        return Matching(pattern.text, points, strays, {})


def _in_rounds(points: list[MeasuredPoint]) -> list[MeasuredPoint]:
    """Poses numbered by the rounds in which the same markers are measured over and over.

    Raises InputError at a marker out of turn, and where the last round is cut short.
    """
    order = list(dict.fromkeys(own.marker for own in points))
    whole = len(points) - len(points) % max(len(order), 1)
    for i, own in enumerate(points):
        if own.marker != order[i % len(order)] or i >= whole:
            what = f"marker {own.marker!r} breaks the round of markers that tells the poses apart"
            raise own.fault(what, "name the poses in the points' names")
    return [replace(own, pose=f"p{i // len(order):04d}") for i, own in enumerate(points)]
