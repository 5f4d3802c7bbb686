"""Lists of measured points, as SpatialAnalyzer and its like export them.

A line holds what SpatialAnalyzer calls the name of a point (collection, group and point, or fewer of
them), its coordinates in the working frame and, where a header names them, its uncertainties (Ux, Uy,
Uz: one standard deviation each, as in that program's ASCII formats) and the time of the measurement.
The unit of length may stand in the header or in a comment, else it must be given.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from calib.arm.se3 import transform
from calib.arrays import Array
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

    path, line : where it stands
    values : what was read, in the columns that the list says
    sigma : standard deviation of one coordinate, root mean square of the three, "" where not given
    time : as written, "" where not given
    pose, marker : what the names tell, once they are matched
    """

    path: Path
    line: int
    collection: str
    group: str
    point: str
    values: tuple[str, ...]
    sigma: str = ""
    time: str = ""
    pose: str = ""
    marker: str = ""

    @property
    def whole_name(self) -> str:
        """All that the operator called it."""
        return "::".join(filter(None, (self.collection, self.group, self.point)))

    def fault(self, what: str, remedy: str) -> InputError:
        return InputError(self.path, f"line {self.line}", what, remedy)


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
    for found in filter(None, map(_ROUND.search, sheet.comments)):
        what = f"holds {found[0].lower()} coordinates"
        raise InputError(path, "header", what, "export Cartesian ones")
    titles = _titles(sheet, columns)
    roles, units = _roles(titles)
    index = _index(sheet, roles)
    unit, unit_from = _unit(sheet, units, unit)
    points = [_point(sheet, row, index, unit) for row in range(len(sheet.rows))]
    ignored = tuple(t for t, role in zip(titles, roles, strict=True) if not role and t != "-")
    return PointList(path, points, tuple(role for role in roles if role), unit, unit_from, ignored)


def _titles(sheet: ExportTable, columns: Sequence[str] | None) -> tuple[str, ...]:
    """Names of the columns: given, from the header, from a comment that holds it, or by number."""
    width = len(sheet.rows[0])
    if columns is not None:
        if sheet.header is not None:
            what = "names its columns itself"
            raise InputError(sheet.path, "line 1", what, "leave --columns out")
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
        what = f"has {width} columns without a header, and their order does not show"
        remedy = (
            "name them, as in --columns collection,group,point,x,y,z,ux,uy,uz (- leaves one out)"
        )
        raise InputError(sheet.path, "", what, remedy)
    if names == 1 and first[0] and re.search(r"\D", sheet.rows[0][0]):
        what = "its first column holds no names"
        raise InputError(sheet.path, "", what, "name the columns with --columns")
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
            remedy = "name the columns point (or group and point), X, Y, Z"
            raise InputError(sheet.path, "header", f"no column is the {role}", remedy)
    if 0 < sum(role in index for role in _UNCERTAINTY) < 3:
        raise InputError(sheet.path, "header", "has not all of Ux, Uy and Uz", "export all three")
    return index


def _unit(sheet: ExportTable, units: Sequence[str], given: str | None) -> tuple[str, str]:
    """The unit of length and who said so. Raises InputError where nobody did, or two differ."""
    unknown = [unit for unit in units if unit and unit != "s" and known_unit(unit) is None]
    if unknown:
        what = f"unit {unknown[0]!r} is not known"
        raise InputError(sheet.path, "header", what, "export in mm, m or in")
    stated = {known for unit in units if (known := known_unit(unit)) is not None}
    stated |= stated_units(sheet.comments)
    if len(stated) > 1:
        what = f"states two units, {' and '.join(sorted(stated))}"
        raise InputError(sheet.path, "header", what, "export in one unit")
    if not stated:
        if given is None:
            remedy = "give --unit mm, --unit m or --unit in"
            raise InputError(sheet.path, "", "states no unit of length", remedy)
        return given, "as given"
    own = stated.pop()
    if given is not None and given != own:
        what = f"states {own}, --unit says {given}"
        raise InputError(sheet.path, "header", what, "leave --unit out")
    return own, "stated in the file"


def _point(sheet: ExportTable, row: int, index: dict[str, int], unit: str) -> MeasuredPoint:
    fields = sheet.rows[row]

    def text(role: str) -> str:
        return fields[index[role]] if role in index else ""

    if not text("point"):
        raise sheet.fault(row, "the point has no name")
    xyz = tuple(in_mm(sheet.number(row, index[role]), unit) for role in _XYZ)
    sigma = ""
    if "ux" in index:
        u = [float(in_mm(sheet.number(row, index[role]), unit)) for role in _UNCERTAINTY]
        if min(u) < 0.0 or not max(u) > 0.0:
            what = "its uncertainty is not above zero"
            raise sheet.fault(row, what, "export without uncertainties, or mend them")
        sigma = f"{math.hypot(*u) / math.sqrt(3.0):.6g}"
    names = (text("collection"), text("group"), text("point"))
    return MeasuredPoint(sheet.path, sheet.lines[row], *names, xyz, sigma, text("time"))


# -- readings of bodies: position in millimetres, and unit quaternion ----------------------------

_BODY = ("x_mm", "y_mm", "z_mm", "qw", "qx", "qy", "qz")
_OFF_UNIT = 1e-3  # how far a quaternion's length may be from one: files round to a few digits


def body_texts(T: Array) -> tuple[str, ...]:
    """The text of a frame (4, 4), m, in the columns of a body."""
    x, y, z, w = Rotation.from_matrix(T[:3, :3]).as_quat(canonical=True)
    place = (f"{1e3 * v:.6f}" for v in T[:3, 3])
    return (*place, *(f"{v + 0.0:.10f}" for v in (w, x, y, z)))


def body_frame(values: Sequence[str]) -> Array:
    """The frame (4, 4), m, of such a text."""
    x, y, z, w, *v = (float(value) for value in values)
    return transform(Rotation.from_quat([*v, w]).as_matrix(), np.array([x, y, z]) * 1e-3)


def quaternion_frame(position: Sequence[float], xyzw: Sequence[float]) -> Array | None:
    """A frame (4, 4) from a position and a quaternion; None where its length is far from one."""
    if not abs(math.hypot(*xyzw) - 1.0) < _OFF_UNIT:
        return None
    return transform(Rotation.from_quat(xyzw).as_matrix(), np.array(position))


def is_rotation(R: Array) -> bool:
    """Whether a matrix (3, 3) is a rotation, as far as files round."""
    off = np.abs(R @ R.T - np.eye(3)).max()
    return bool(off < _OFF_UNIT and np.linalg.det(R) > 0.0)


def body_list(
    path: Path,
    read: Iterable[tuple[int, str, str, Array]],
    columns: tuple[str, ...],
    unit: tuple[str, str],
    note: str = "",
    frames: bool = False,
) -> PointList:
    """Readings of bodies as a list whose groups are the poses.

    read : line, pose, body and its frame (4, 4), m; unit : and where it is stated
    """
    points = [
        MeasuredPoint(path, line, "", pose, body, body_texts(T)) for line, pose, body, T in read
    ]
    notes = (f"{path}: {note}",) * bool(note)
    return PointList(path, points, columns, *unit, (), _BODY, "{pose}::{marker}", frames, notes)
