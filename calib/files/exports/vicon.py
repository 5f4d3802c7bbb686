"""Rigid bodies as Vicon's Tracker and Nexus export them: a section ``Segments`` or ``Objects``.

RX, RY, RZ are a rotation vector, with RW a quaternion, and TX, TY, TZ the place; units stand below the
titles, names above them.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from calib.errors import InputError
from calib.files.exports.recording import METRES, RADIANS, Body, Layout, Row


def vicon_layout(path: Path, rows: list[Row]) -> Layout:
    """Where the segments of Vicon stand. Raises InputError for other columns, and for no units."""
    section = next((k for k, (_, row) in enumerate(rows) if row[0].lower() in SECTIONS), 0)
    below = range(section, len(rows))
    titles = next((k for k in below if rows[k][1][0].lower() == "frame"), 0)
    head = [title.upper() for title in rows[titles][1]]
    if titles < 1 or "RX" not in head or len(rows) < titles + 2:
        what = "has no columns Frame, Sub Frame, RX, RY, RZ, TX, TY, TZ"
        raise InputError(path, "", what, "export the segments, or objects")
    names, units = rows[titles - 1][1], [unit.lower() for unit in rows[titles + 1][1]]
    wanted = ("RX", "RY", "RZ", "RW", "TX", "TY", "TZ") if "RW" in head else _SIX
    found: list[Body] = []
    for k in (k for k, title in enumerate(head) if title == "RX"):
        part = tuple(head[k : k + len(wanted)])
        if part != wanted:
            what = f"has the columns {' '.join(part)}, where {' '.join(wanted)} are read"
            raise InputError(
                path, f"line {rows[titles][0]}", what, "export the segments, or objects"
            )
        name = names[k] if k < len(names) and names[k] else f"body{len(found) + 1}"
        columns = tuple(range(k, k + len(wanted)))
        found.append(Body(_single(name), columns[:-3], columns[-3:]))
    angle = _unit_of(path, rows[titles + 1][0], units, found, "rotation")
    unit = _unit_of(path, rows[titles + 1][0], units, found, "place")
    return Layout(found, titles + 2, unit, angle or "rad")


SECTIONS = ("segments", "objects")
_SIX = ("RX", "RY", "RZ", "TX", "TY", "TZ")


def _single(name: str) -> str:
    """An object is a subject with one segment of the same name."""
    subject, _, segment = name.partition(":")
    return subject if subject == segment else name


def _unit_of(path: Path, line: int, units: list[str], bodies: Sequence[Body], part: str) -> str:
    """The one unit of all columns of a part. Raises InputError."""
    known = RADIANS if part == "rotation" else METRES
    quaternion = part == "rotation" and len(bodies[0].rotation) == 4
    found = {units[k] if k < len(units) else "" for own in bodies for k in getattr(own, part)}
    if len(found) == 1 and (quaternion or found <= known.keys()):
        return found.pop()
    what = f"states no one unit of the {part} ({', '.join(sorted(found))[:40]!r})"
    raise InputError(path, f"line {line}", what, f"export in {' or '.join(known)}")
