"""Read the CSV tables: measurements, plans and targets. Units stand in the column names."""

from __future__ import annotations

import csv
import difflib
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calib.cell import Cell
from calib.errors import InputError
from calib.poses import IntArray, Measurements, Poses, hung, poses_at
from calib.robot import Robot
from calib.se3 import Array

_LARGEST_FILE = 500_000_000  # bytes, some three million rows
_LONGEST_LINE = 65_536  # characters; a longer one is no table of numbers
_ANGLES = {"deg": math.pi / 180, "rad": 1.0}
_LENGTHS = {"mm": 1e-3, "m": 1.0}
_WRENCH = ("fx_N", "fy_N", "fz_N", "mx_Nm", "my_Nm", "mz_Nm")
_FIXED = ("pose", "marker", "station", "temperature_degC", "time_s", "sigma_mm", "level", "weight")
_RADIANS_LOOK = 2 * math.pi + 0.1  # a whole table of degrees below this is probably radians


@dataclass(frozen=True)
class _Table:
    """A CSV file as columns of text, with the line of each row."""

    path: Path
    columns: tuple[str, ...]
    rows: list[list[str]]
    lines: list[int]

    def text(self, column: str) -> list[str]:
        i = self.columns.index(column)
        return [row[i].strip() for row in self.rows]

    def numbers(self, column: str) -> Array:
        """A column of finite numbers; raises InputError naming line and column."""
        i = self.columns.index(column)
        try:
            values = np.array([row[i] for row in self.rows], dtype=float)
        except ValueError:
            values = np.array([self._number(i, r) for r in range(len(self.rows))])
        if not np.isfinite(values).all():
            bad = int(np.flatnonzero(~np.isfinite(values))[0])
            raise self.fault(bad, column, f"{self.rows[bad][i]!r} is not a finite number")
        return values

    def _number(self, column: int, row: int) -> float:
        cell = self.rows[row][column]
        try:
            return float(cell)
        except ValueError:
            remedy = "leave the row out if the point was not measured"
            what = f"{cell[:40]!r} is not a number" if cell.strip() else "is empty"
            raise self.fault(row, self.columns[column], what, remedy) from None

    def fault(self, row: int, column: str, what: str, remedy: str = "") -> InputError:
        return InputError(self.path, f"line {self.lines[row]}, column {column}", what, remedy)


def _bounded_lines(path: Path) -> Iterator[str]:
    with path.open(encoding="utf-8-sig", newline="") as file:
        number = 0
        while line := file.readline(_LONGEST_LINE):
            number += 1
            if "\0" in line or len(line) >= _LONGEST_LINE:
                raise InputError(path, f"line {number}", "is no line of a CSV table")
            yield line


def _read(path: Path, required: Sequence[str], check: Callable[[tuple[str, ...]], None]) -> _Table:
    """The whole table; the header is checked before any row is read."""
    rows: list[list[str]] = []
    lines: list[int] = []
    try:
        if path.stat().st_size > _LARGEST_FILE:
            raise InputError(path, "", f"is larger than {_LARGEST_FILE / 1e6:.0f} MB", "split it")
        reader = csv.reader(_bounded_lines(path), strict=True)
        columns = tuple(name.strip() for name in next(reader, []))
        if not any(columns):
            raise InputError(path, "", "is empty", "the first line must name the columns")
        for name in columns:
            if name and columns.count(name) > 1:
                raise InputError(path, "line 1", f"column {name!r} stands twice")
        for name in required:
            if name not in columns:
                raise InputError(path, "line 1", f"column {name!r} is missing")
        check(columns)
        for row in reader:
            if not row:
                continue
            if len(row) != len(columns):
                raise InputError(
                    path,
                    f"line {reader.line_num}",
                    f"has {len(row)} fields where the header names {len(columns)}",
                )
            rows.append(row)
            lines.append(reader.line_num)
    except UnicodeDecodeError:
        raise InputError(path, "", "is not text in UTF-8", "export it as CSV") from None
    except csv.Error as error:
        raise InputError(path, f"line {reader.line_num}", f"is no CSV ({error})") from None
    except OSError as error:
        raise InputError(path, "", f"cannot be read ({error.strerror})", "check the path") from None
    if not rows:
        raise InputError(path, "", "has a header and no rows")
    return _Table(path, columns, rows, lines)


# -- columns ---------------------------------------------------------------------------------------


def _joint_columns(path: Path, robot: Robot, columns: tuple[str, ...]) -> list[tuple[str, float]]:
    """Column and SI factor of each joint. Raises InputError where one is missing or has no unit."""
    found = []
    for joint, slides in zip(robot.joints, robot.prismatic, strict=True):
        units = _LENGTHS if slides else _ANGLES
        named = [(f"{joint}_{unit}", scale) for unit, scale in units.items()]
        present = [pair for pair in named if pair[0] in columns]
        if len(present) > 1:
            raise InputError(path, "line 1", f"joint {joint} stands in two units", "keep one")
        if not present:
            wanted = " or ".join(name for name, _ in named)
            if joint in columns:
                raise InputError(
                    path, "line 1", f"column {joint!r} has no unit", f"name it {wanted}"
                )
            raise InputError(path, "line 1", f"no column for joint {joint}", f"add {wanted}")
        found.append(present[0])
    return found


def _point_columns(path: Path, columns: tuple[str, ...]) -> list[tuple[str, float]]:
    found = []
    for axis in "xyz":
        present = [(f"{axis}_{u}", s) for u, s in _LENGTHS.items() if f"{axis}_{u}" in columns]
        if not present:
            bare = axis in columns
            what = f"column {axis!r} has no unit" if bare else f"column {axis}_mm is missing"
            raise InputError(path, "line 1", what, f"name it {axis}_mm or {axis}_m")
        found.append(present[0])
    return found


def _check_known(path: Path, robot: Robot, columns: tuple[str, ...]) -> tuple[str, ...]:
    """Warnings about columns that are ignored. Raises InputError for a joint that is not there."""
    units = ("deg", "rad", "mm", "m")
    known = {*_FIXED, *_WRENCH, *(f"{a}_{u}" for a in "xyz" for u in ("mm", "m"))}
    known |= {f"{j}_{u}" for j in robot.joints for u in units}
    known |= {f"approach_{j}" for j in robot.joints}
    ignored = []
    for name in columns:
        unit = name.rpartition("_")[2]
        if name in known or not name:
            continue
        if unit in ("deg", "rad") or name.startswith("approach_"):
            raise InputError(
                path,
                "line 1",
                f"column {name!r} names no joint of the robot",
                f"joints are {', '.join(robot.joints)}",
            )
        if name.partition("_")[0] in {c.partition("_")[0] for c in (*_WRENCH, *_FIXED)}:
            close = difflib.get_close_matches(name, [*_WRENCH, *_FIXED], n=1)
            raise InputError(
                path,
                "line 1",
                f"column {name!r} has no known unit",
                f"name it {(close or ['?'])[0]}",
            )
        ignored.append(name)
    return (f"{path}: ignored columns: {', '.join(ignored)}",) if ignored else ()


def _joint_values(table: _Table, robot: Robot) -> Array:
    pairs = _joint_columns(table.path, robot, table.columns)
    return np.column_stack([table.numbers(name) * scale for name, scale in pairs])


def _joint_warnings(table: _Table, robot: Robot, q: Array) -> tuple[str, ...]:
    warnings = []
    turning = ~robot.prismatic
    in_degrees = [f"{j}_deg" in table.columns for j in np.array(robot.joints)[turning]]
    if turning.any() and all(in_degrees):
        largest = float(np.degrees(np.abs(q[:, turning]).max()))
        if 0.0 < largest < _RADIANS_LOOK and len(table.rows) > 2:
            warnings.append(
                f"{table.path}: joint angles reach only {largest:.3g} degrees: the range looks like "
                "radians; if so, name the columns <joint>_rad"
            )
    margin = 1e-4  # rad or m: rounding of the URDF's limits
    outside = (q < robot.limits[:, 0] - margin) | (q > robot.limits[:, 1] + margin)
    for j in np.flatnonzero(outside.any(axis=0)):
        row = int(np.flatnonzero(outside[:, j])[0])
        shown = q[row, j] * 1e3 if robot.prismatic[j] else math.degrees(q[row, j])
        unit = "mm" if robot.prismatic[j] else "deg"
        warnings.append(
            f"{table.path}: line {table.lines[row]}: joint {robot.joints[j]} at {shown:.2f} {unit} is "
            f"outside its limits ({int(outside[:, j].sum())} rows in all); check joint names and units"
        )
    return tuple(warnings)


def _covariates(table: _Table, robot: Robot, rows: IntArray) -> dict[str, Any]:
    """Optional columns, at one row for each pose."""
    found: dict[str, Any] = {}
    wrench = np.zeros((len(rows), 6))
    for i, name in enumerate(_WRENCH):
        if name in table.columns:
            wrench[:, i] = table.numbers(name)[rows]
    found["wrench"] = wrench
    for key, name in (("temperature", "temperature_degC"), ("time", "time_s")):
        if name in table.columns:
            found[key] = table.numbers(name)[rows]
    signs = [f"approach_{joint}" for joint in robot.joints]
    present = [name for name in signs if name in table.columns]
    if present and len(present) < len(signs):
        missing = next(name for name in signs if name not in present)
        raise InputError(
            table.path, "line 1", f"column {missing!r} is missing beside {present[0]!r}"
        )
    if present:
        approach = np.column_stack([table.numbers(name) for name in signs])
        bad = np.argwhere(~np.isin(approach, (-1.0, 0.0, 1.0)))
        if len(bad):
            raise table.fault(int(bad[0, 0]), signs[int(bad[0, 1])], "is not -1, 0 or +1")
        found["approach"] = approach[rows]
    if "station" in table.columns:
        names = table.text("station")
        stations = tuple(sorted(set(names)))
        found["stations"] = stations
        found["station"] = np.array([stations.index(names[row]) for row in rows])
    return found


# -- tables ----------------------------------------------------------------------------------------


def load_measurements(cell: Cell, path: str | Path) -> Measurements:
    """Read measured points, one row a point, into arrays with a mask for hidden markers.

    Raises InputError naming line and column for what is missing, doubled, contradictory or no
    number. What is odd but usable is listed in ``Measurements.warnings``.
    """
    path = Path(path)
    warnings: list[str] = []

    def check(columns: tuple[str, ...]) -> None:
        warnings.extend(_check_known(path, cell.robot, columns))
        _joint_columns(path, cell.robot, columns)
        _point_columns(path, columns)

    table = _read(path, ("pose", "marker"), check)
    q_rows = _joint_values(table, cell.robot)
    warnings.extend(_joint_warnings(table, cell.robot, q_rows))
    pose_names, pose_of_row = _number_in_order(table.text("pose"))
    marker_of_row = _markers(table, cell)
    _, first = np.unique(pose_of_row, return_index=True)
    given = _covariates(table, cell.robot, first)
    poses = poses_at(q_rows[first], pose_names, **given)
    _check_poses_agree(table, cell.robot, pose_of_row, first)

    m, M = len(pose_names), len(cell.marker_names)
    points, seen, sigma = np.zeros((m, M, 3)), np.zeros((m, M), dtype=bool), np.full((m, M), np.nan)
    for row, (i, j) in enumerate(zip(pose_of_row, marker_of_row, strict=True)):
        if seen[i, j]:
            raise table.fault(
                row,
                "marker",
                f"pose {pose_names[i]!r} has marker {cell.marker_names[j]!r} twice",
                "give a repeated reading its own pose identifier",
            )
        seen[i, j] = True
    columns = _point_columns(path, table.columns)
    xyz = np.column_stack([table.numbers(name) * scale for name, scale in columns])
    points[pose_of_row, marker_of_row] = xyz
    if "sigma_mm" in table.columns:
        own = table.numbers("sigma_mm") * 1e-3
        if (own <= 0).any():
            raise table.fault(int(np.flatnonzero(own <= 0)[0]), "sigma_mm", "must be above zero")
        sigma[pose_of_row, marker_of_row] = own
    for j in np.flatnonzero(~seen.any(axis=0)):
        raise InputError(
            path,
            f"marker {cell.marker_names[j]}",
            "is in the cell's [markers_mm] and never measured",
            "measure it or take it out of the cell",
        )
    return Measurements(poses, points, seen, sigma, tuple(warnings))


def _number_in_order(
    names: list[str],
) -> tuple[tuple[str, ...], IntArray]:
    """Distinct names in order of appearance, and the position of each row's name."""
    order = {name: i for i, name in enumerate(dict.fromkeys(names))}
    return tuple(order), np.array([order[name] for name in names])


def _markers(table: _Table, cell: Cell) -> IntArray:
    numbers = {name: i for i, name in enumerate(cell.marker_names)}
    names = table.text("marker")
    for row, name in enumerate(names):
        if name not in numbers:
            known = ", ".join(cell.marker_names)
            raise table.fault(row, "marker", f"{name!r} is not in the cell's [markers_mm]", known)
    return np.array([numbers[name] for name in names])


def _check_poses_agree(
    table: _Table,
    robot: Robot,
    pose_of_row: IntArray,
    first: IntArray,
) -> None:
    """Rows of one pose must share joints, wrench, time and heat."""
    own = {"marker", "sigma_mm", *(f"{a}_{u}" for a in "xyz" for u in ("mm", "m"))}
    units = ("deg", "rad", "mm", "m")
    shared = {*_FIXED, *_WRENCH, *(f"{j}_{u}" for j in robot.joints for u in units)}
    shared |= {f"approach_{j}" for j in robot.joints}
    for name in table.columns:
        if name in shared - own - {"pose"}:
            values = np.array(table.text(name))
            bad = np.flatnonzero(values != values[first][pose_of_row])
            if len(bad):
                row = int(bad[0])
                pose = table.text("pose")[row]
                raise table.fault(
                    row, name, f"differs from the other rows of pose {pose!r}", "rename the pose"
                )


def _load_poses(cell: Cell, path: Path, required: Sequence[str]) -> tuple[Poses, _Table]:
    warnings: list[str] = []

    def check(columns: tuple[str, ...]) -> None:
        warnings.extend(_check_known(path, cell.robot, columns))
        _joint_columns(path, cell.robot, columns)

    table = _read(path, required, check)
    q = _joint_values(table, cell.robot)
    given = _covariates(table, cell.robot, np.arange(len(q)))
    if "pose" in table.columns:
        names = table.text("pose")
        known: set[str] = set()
        for row, name in enumerate(names):
            if name in known:
                raise table.fault(row, "pose", f"{name!r} stands twice")
            known.add(name)
        given["names"] = tuple(names)
    return poses_at(q, **given), table


def load_plan(cell: Cell, path: str | Path) -> Poses:
    """Read a plan: pose identifiers, joints, optional wrench. Raises InputError."""
    poses, _ = _load_poses(cell, Path(path), ("pose",))
    return poses


def load_targets(cell: Cell, path: str | Path) -> tuple[Poses, Array]:
    """Read target poses and their weights, shape (targets,). Raises InputError.

    A target without wrench columns carries the cell's [load], if there is one.
    """
    path = Path(path)
    poses, table = _load_poses(cell, path, ())
    weights = np.ones(len(poses))
    if "weight" in table.columns:
        weights = table.numbers("weight")
        if (weights < 0).any() or not weights.any():
            raise InputError(path, "column weight", "must be at least zero, and not all zero")
    if cell.load is not None and not any(name in table.columns for name in _WRENCH):
        poses = hung(poses, cell.load.mass, cell.load.com)
    return poses, weights
