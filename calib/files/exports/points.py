"""Lists of measured points, as SpatialAnalyzer and its like export them.

A line holds what SpatialAnalyzer calls the name of a point (collection, group and point, or fewer of
them), its coordinates in the working frame and, where a header names them, its uncertainties (Ux, Uy,
Uz: one standard deviation each, as in that program's ASCII formats) and the time of the measurement.
The unit of length may stand in the header or in a comment, else it must be given.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from calib.errors import InputError
from calib.files.exports.sheet import ExportTable, in_mm, known_unit, read_sheet, stated_units

_ROLES = {
    "collection": ("collection", "collectionname"),
    "group": ("group", "groupname", "pointgroup", "pose"),
    "point": ("point", "pointname", "pointid", "target", "targetname", "name", "marker"),
    **{role: (role,) for role in ("x", "y", "z", "ux", "uy", "uz")},
    "time": ("time", "timestamp", "datetime"),
}
_ROLE_OF = {name: role for role, names in _ROLES.items() for name in names}
ROLES = tuple(_ROLES)
_XYZ = ("x", "y", "z")
_UNCERTAINTY = ("ux", "uy", "uz")
_BY_WIDTH = {
    4: ("point", *_XYZ),
    5: ("group", "point", *_XYZ),
    6: ("collection", "group", "point", *_XYZ),
}
_ROUND = re.compile(r"\b(?:cylindric|spheric|polar)(?:al)?\b", re.IGNORECASE)
_WITH_UNIT = re.compile(r"(.*?)\s*(?:[\[(]\s*([A-Za-z]+)\s*[\])]|[_ ](mm|m|in|s))")


@dataclass(frozen=True, slots=True)
class MeasuredPoint:
    """One reading of a list: names as written, numbers as text, lengths in millimetres.

    values : what was read, in the columns that the list says
    sigma : standard deviation of one coordinate, root mean square of the three, "" where not given
    time : as written, "" where not given
    """

    line: int
    collection: str
    group: str
    point: str
    values: tuple[str, ...]
    sigma: str
    time: str


@dataclass(frozen=True)
class PointList:
    """A file of readings: which columns were read, the unit and where it stood, and what was not read.

    written : columns of measurements.csv that a reading fills
    names : the pattern by which these lists tell pose and marker, "" where people name the points
    frames : whether the readings of a body at one pose are frames of a recording, to be averaged
    notes : what is said of the file
    """

    path: Path
    points: list[MeasuredPoint]
    columns: tuple[str, ...]
    unit: str
    unit_from: str
    ignored: tuple[str, ...]
    written: tuple[str, ...] = ("x_mm", "y_mm", "z_mm")
    names: str = ""
    frames: bool = False
    notes: tuple[str, ...] = ()


def read_points(
    path: Path, unit: str | None = None, columns: Sequence[str] | None = None
) -> PointList:
    """Read a list of points.

    unit : ``mm``, ``m`` or ``in``, where the file does not state it
    columns : roles of the columns of a file without a header, ``-`` for one to leave out

    Raises InputError, with the line, for what is missing, contradictory or no number.
    """
    sheet = read_sheet(path)
    _check_cartesian(sheet)
    titles = _titles(sheet, columns)
    roles, units = _roles(titles)
    index = _index(sheet, roles)
    unit, unit_from = _unit(sheet, units, unit)
    points = [_point(sheet, row, index, unit) for row in range(len(sheet.rows))]
    ignored = tuple(t for t, role in zip(titles, roles, strict=True) if not role and t != "-")
    return PointList(path, points, tuple(role for role in roles if role), unit, unit_from, ignored)


def _check_cartesian(sheet: ExportTable) -> None:
    for line in sheet.comments:
        if found := _ROUND.search(line):
            raise InputError(
                sheet.path,
                "header",
                f"holds {found[0].lower()} coordinates",
                "export Cartesian ones",
            )


def _titles(sheet: ExportTable, columns: Sequence[str] | None) -> tuple[str, ...]:
    """Names of the columns: given, from the header, from a comment that holds it, or by number."""
    width = len(sheet.rows[0])
    if columns is not None:
        if sheet.header is not None:
            raise InputError(
                sheet.path, "line 1", "names its columns itself", "leave --columns out"
            )
        if len(columns) != width:
            what = f"lines have {width} fields where --columns names {len(columns)}"
            raise InputError(sheet.path, "", what, "name every column, - for one to leave out")
        return tuple(columns)
    if sheet.header is not None:
        return sheet.header
    for comment in sheet.comments:
        titles = sheet.split(comment)
        if len(titles) == width and set(_XYZ) <= set(_roles(titles)[0]):
            return titles
    return _by_position(sheet)


def _by_position(sheet: ExportTable) -> tuple[str, ...]:
    """SpatialAnalyzer's orders of names and coordinates, as far as the fields decide on one."""
    width = len(sheet.rows[0])
    first = [sheet.is_number(0, column) for column in range(width)]
    if width == 5 and first[1:] == [True, True, True, False]:
        return ("point", *_XYZ, "group")
    titles = _BY_WIDTH.get(width)
    names = width - 3
    if titles is None or not all(first[names:]) or (names > 1 and all(first)):
        raise InputError(
            sheet.path,
            "",
            f"has {width} columns without a header, and their order does not show",
            "name them, as in --columns collection,group,point,x,y,z,ux,uy,uz (- leaves one out)",
        )
    if names == 1 and first[0] and re.search(r"\D", sheet.rows[0][0]):
        raise InputError(
            sheet.path, "", "its first column holds no names", "name the columns with --columns"
        )
    return titles


def _roles(titles: Sequence[str]) -> tuple[list[str], list[str]]:
    """Role of each column, "" for none, and the unit that its title states, "" for none."""
    roles, units = [], []
    for title in titles:
        match = _WITH_UNIT.fullmatch(title.strip())
        name, unit = (match[1], match[2] or match[3]) if match else (title, "")
        role = _ROLE_OF.get(re.sub(r"[\s_.-]", "", name.lower()), "")
        roles.append(role)
        units.append(unit if role else "")
    return roles, units


def _index(sheet: ExportTable, roles: Sequence[str]) -> dict[str, int]:
    index: dict[str, int] = {}
    for column, role in enumerate(roles):
        if role in index:
            raise InputError(sheet.path, "header", f"two columns are the {role}", "rename one")
        if role:
            index[role] = column
    for role in ("point", *_XYZ):
        if role not in index:
            raise InputError(
                sheet.path,
                "header",
                f"no column is the {role}",
                "name the columns point (or group and point), X, Y, Z",
            )
    if 0 < sum(role in index for role in _UNCERTAINTY) < 3:
        raise InputError(sheet.path, "header", "has not all of Ux, Uy and Uz", "export all three")
    return index


def _unit(sheet: ExportTable, units: Sequence[str], given: str | None) -> tuple[str, str]:
    """The unit of length and who said so. Raises InputError where nobody did, or two differ."""
    unknown = [unit for unit in units if unit and unit != "s" and known_unit(unit) is None]
    if unknown:
        raise InputError(
            sheet.path, "header", f"unit {unknown[0]!r} is not known", "export in mm, m or in"
        )
    stated = {known for unit in units if (known := known_unit(unit)) is not None}
    stated |= stated_units(sheet.comments)
    if len(stated) > 1:
        what = f"states two units, {' and '.join(sorted(stated))}"
        raise InputError(sheet.path, "header", what, "export in one unit")
    if not stated:
        if given is None:
            raise InputError(
                sheet.path, "", "states no unit of length", "give --unit mm, --unit m or --unit in"
            )
        return given, "as given"
    own = stated.pop()
    if given is not None and given != own:
        raise InputError(
            sheet.path, "header", f"states {own}, --unit says {given}", "leave --unit out"
        )
    return own, "stated in the file"


def _point(sheet: ExportTable, row: int, index: dict[str, int], unit: str) -> MeasuredPoint:
    fields = sheet.rows[row]

    def text(role: str) -> str:
        return fields[index[role]] if role in index else ""

    if not text("point"):
        raise sheet.fault(row, "the point has no name")
    x, y, z = (in_mm(sheet.number(row, index[role]), unit) for role in _XYZ)
    sigma = _sigma(sheet, row, index, unit) if "ux" in index else ""
    return MeasuredPoint(
        sheet.lines[row],
        text("collection"),
        text("group"),
        text("point"),
        (x, y, z),
        sigma,
        text("time"),
    )


def _sigma(sheet: ExportTable, row: int, index: dict[str, int], unit: str) -> str:
    values = [float(in_mm(sheet.number(row, index[role]), unit)) for role in _UNCERTAINTY]
    if min(values) < 0.0 or not max(values) > 0.0:
        raise sheet.fault(
            row, "its uncertainty is not above zero", "export without uncertainties, or mend them"
        )
    return f"{math.hypot(*values) / math.sqrt(3.0):.6g}"
