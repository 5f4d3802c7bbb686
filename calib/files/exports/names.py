"""Pose and marker of a point, from the name that the operator gave it.

A pattern says how: ``{pose}::{marker}`` reads the group as the pose and the point as the marker,
``{pose}_{marker}`` both from the point's name, ``{pose}/{marker}`` the pose from the file's name;
``*`` stands for any text. Without a pattern the usual ones are tried.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from calib.errors import InputError
from calib.files.exports.points import MeasuredPoint

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
