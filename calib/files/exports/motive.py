"""Rigid bodies as OptiTrack's Motive exports them: its first line says how, titles stand in columns."""

from __future__ import annotations

from pathlib import Path

from calib.errors import InputError
from calib.files.exports.recording import Body, Layout, Row

_UNITS = {
    "millimeters": "mm", "centimeters": "cm", "meters": "m", "inches": "in", "feet": "ft",
}  # fmt: skip


def motive_layout(path: Path, rows: list[Row]) -> Layout:
    """Where the bodies of Motive stand. Raises InputError for another rotation, space or unit."""
    unit = _unit(path, rows[0][1])
    titles = next((k for k, (_, row) in enumerate(rows) if row[0].lower() == "frame"), 0)
    label = {row[1].lower(): row for _, row in rows[:titles] if len(row) > 1 and row[1]}
    if titles < 3 or not {"type", "name"} <= label.keys():
        raise InputError(path, "", "has no header of types and names", "export with its header")
    kinds, names = label["type"], label["name"]
    quantities, axes = rows[titles - 1][1], rows[titles][1]
    columns: dict[str, dict[tuple[str, str], int]] = {}
    for k, (kind, name, quantity, axis) in enumerate(
        zip(kinds, names, quantities, axes, strict=False)
    ):
        if kind.lower() == "rigid body":
            columns.setdefault(name, {}).setdefault((quantity.lower(), axis.lower()), k)
    found = []
    for name, own in columns.items():
        wanted = [("rotation", axis) for axis in "xyzw"], [("position", axis) for axis in "xyz"]
        if not {*wanted[0], *wanted[1]} <= own.keys():
            raise InputError(
                path, f"body {name}", "has not all of rotation X Y Z W and position X Y Z"
            )
        found.append(Body(name, *(tuple(own[key] for key in keys) for keys in wanted)))
    if not found:
        raise InputError(path, "", "holds no rigid body", "export with Rigid Bodies")
    return Layout(found, titles + 1, unit)


def _unit(path: Path, head: list[str]) -> str:
    """The unit of length that the first line states. Raises InputError for what is not read."""
    said = {k.lower(): v.lower() for k, v in zip(head[::2], head[1::2], strict=False)}
    if said.get("rotation type") != "quaternion":
        what = f"has the rotation type {said.get('rotation type', '')[:20]!r}"
        raise InputError(path, "line 1", what, "export with rotation type Quaternion")
    if said.get("coordinate space", "global") != "global":
        what = f"has {said['coordinate space'][:20]} coordinates"
        raise InputError(path, "line 1", what, "export in global coordinate space")
    unit = _UNITS.get(said.get("length units", ""), "")
    if not unit:
        what = f"states no known unit of length ({said.get('length units', '')[:20]!r})"
        raise InputError(path, "line 1", what, "export in Meters or Millimeters")
    return unit
