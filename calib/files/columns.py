"""What the columns of the tables mean: joints, loads and covariates, with their units."""

from __future__ import annotations

import difflib
import itertools
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from calib.arm.robot import Robot
from calib.arrays import Array, IntArray
from calib.errors import InputError
from calib.files.csv_table import CsvTable

_CLOCK = "time_s counts seconds: divide milliseconds since 1970 by 1000"
UNITS = {
    "length": {"mm": 1e-3, "m": 1.0},
    "angle": {"deg": math.pi / 180.0, "rad": 1.0},
    "pixel": {"px": 1.0},
    "ratio": {"": 1.0},
}
"""Of every quantity that a table may hold, and their sizes in SI; the first one is written."""
ANGLES, LENGTHS = UNITS["angle"], UNITS["length"]
WRENCH = ("fx_N", "fy_N", "fz_N", "mx_Nm", "my_Nm", "mz_Nm")
SIGMAS = {"sigma_mm": ("mm", 1e-3), "sigma_px": ("px", 1.0)}
"""Standard deviations of single rows: unit of the numbers that they are of, and its size."""
_NAMES = ("pose", "marker", "instrument", "station", "session")
_COVARIATES = ("temperature_degC", "time_s", "order")
OTHERS = (*_NAMES, *_COVARIATES, *SIGMAS, "level", "weight")
_MOST_TURNS = 100.0
_ALIKE = 0.8  # of names that may be meant for each other


class Column(NamedTuple):
    """A column of numbers, and its unit in SI."""

    name: str
    scale: float


def titles(name: str, units: Mapping[str, float]) -> dict[str, float]:
    """Columns that may hold a number, ``name_unit``, and SI per unit."""
    return {f"{name}_{unit}" if unit else name: scale for unit, scale in units.items()}


def column_of(
    path: Path, columns: Sequence[str], name: str, units: Mapping[str, float], whose: str
) -> Column | None:
    """The column of a number; None where there is none. Raises InputError for no unit, and for two."""
    present = [Column(*own) for own in titles(name, units).items() if own[0] in columns]
    if len(present) > 1:
        raise InputError(path, "line 1", f"{whose} stands in two units", "keep one")
    if not present and name in columns:
        remedy = f"name it {' or '.join(titles(name, units))}"
        raise InputError(path, "line 1", f"column {name!r} has no unit", remedy)
    return present[0] if present else None


def units_of(slides: bool) -> dict[str, float]:
    """Units of a joint."""
    return LENGTHS if slides else ANGLES


def joint_columns(path: Path, robot: Robot, columns: tuple[str, ...]) -> list[Column | None]:
    """Where each joint is given. Raises InputError where a column is missing or has no unit.

    A joint that others move may have a column; None where it has none, as they give it.
    """
    given: list[Column | None] = []
    for name, slides in zip(robot.joints, robot.prismatic.tolist(), strict=True):
        given.append(column_of(path, columns, name, units_of(slides), f"joint {name}"))
        if given[-1] is None and name not in robot.undriven:
            raise _missing(path, name, slides, columns)
    return given


def _missing(path: Path, name: str, slides: bool, columns: tuple[str, ...]) -> InputError:
    """What to say of a joint that no column gives, or that has one in another unit."""
    right = " or ".join(titles(name, units_of(slides)))
    for column in titles(name, units_of(not slides)):
        if column in columns:
            does = "slides" if slides else "turns"
            what = f"column {column!r} is no unit of joint {name}, which {does}"
            return InputError(path, "line 1", what, f"name it {right}")
    return InputError(path, "line 1", f"no column for joint {name}", f"add {right}")


def check_known(
    path: Path, robot: Robot, columns: tuple[str, ...], readings: set[str]
) -> tuple[str, ...]:
    """Warnings about columns that are ignored. Raises InputError for a joint that is not there.

    readings : columns that hold what the instruments read
    """
    known, ignored = {*OTHERS, *readings, *shared_columns(robot)}, []
    for name in (own for own in columns if own and own not in known):
        fault = _fault_of_column(name, robot, columns)
        if fault is None:
            ignored.append(name)
            continue
        what, remedy = (f"column {name!r} is not known", fault) if isinstance(fault, str) else fault
        raise InputError(path, "line 1", what, remedy)
    return (f"{path}: ignored columns: {', '.join(ignored)}",) if ignored else ()


def _fault_of_column(
    name: str, robot: Robot, columns: tuple[str, ...]
) -> tuple[str, str] | str | None:
    """What is wrong with an unknown column and what to do; None where it may mean nothing."""
    unit, others = name.rpartition("_")[2], [*OTHERS, *WRENCH]
    if unit in ("deg", "rad") or name.startswith("approach_"):
        alike = {
            c.casefold(): c for c in sorted({f"{j}_{unit}" for j in robot.joints} - {*columns})
        }
        meant = difflib.get_close_matches(name.casefold(), alike, n=1, cutoff=_ALIKE)
        remedy = "".join(f"did you mean {alike[own]!r}? " for own in meant)
        remedy += f"joints are {', '.join(robot.joints)}"
        return f"column {name!r} names no joint of the robot", remedy
    if name.partition("_")[0] in {c.partition("_")[0] for c in others}:
        close = difflib.get_close_matches(name, [*WRENCH, *OTHERS], n=1) or ["?"]
        return f"column {name!r} has no known unit", f"name it {close[0]}"
    near = difflib.get_close_matches(name, others, n=1, cutoff=_ALIKE)
    return f"did you mean {near[0]!r}?" if near else None


def shared_columns(robot: Robot) -> set[str]:
    """Columns in which all rows of one pose must agree: joints, wrench, time and heat."""
    shared = {*OTHERS, *WRENCH, *torque_columns(robot), *(f"approach_{j}" for j in robot.joints)}
    shared |= {f"{j}_{unit}" for j in robot.joints for unit in (*ANGLES, *LENGTHS)}
    return shared - {"pose", "marker", "instrument", *SIGMAS}


def torque_columns(robot: Robot) -> tuple[str, ...]:
    """Column of the torque, or force, that the arm measured at each joint."""
    each = zip(robot.joints, robot.prismatic, strict=True)
    return tuple(f"{joint}_{'N' if slides else 'Nm'}" for joint, slides in each)


def joint_values(table: CsvTable, robot: Robot) -> Array:
    """Joint values of every row, shape (rows, n), rad and m."""
    given = joint_columns(table.path, robot, table.columns)
    none = np.zeros(len(table.rows))
    q = np.column_stack([none if c is None else table.numbers(c.name) * c.scale for c in given])
    implied = [column is None for column in given]
    q[:, implied] = robot.tied(q)[:, implied]
    turns = np.abs(q) / (2.0 * math.pi)
    for row, j in np.argwhere((turns > _MOST_TURNS) & ~robot.prismatic)[:1]:
        column, what = given[j], f"is an angle of {turns[row, j]:.0f} turns"
        name = robot.joints[j] if column is None else column.name
        remedy = "counts of an encoder and angles of the motor are none of the joint"
        raise table.fault(row, name, what, f"check its unit: {remedy}")
    return q


def covariates(table: CsvTable, robot: Robot, rows: IntArray) -> dict[str, Any]:
    """Optional columns, at one row for each pose."""
    fields: dict[str, Any] = {"wrench": _columns(table, WRENCH)[rows]}
    for key, name in (("temperature", "temperature_degC"), ("time", "time_s")):
        if name in table.columns:
            fields[key] = table.numbers(name, remedy=_CLOCK if key == "time" else "")[rows]
    driven = [joint not in robot.undriven for joint in robot.joints]
    if (torque := _of_joints(table, torque_columns(robot), driven)) is not None:
        fields["torque"] = torque[rows]
    signs = [f"approach_{joint}" for joint in robot.joints]
    if (approach := _of_joints(table, signs, driven)) is not None:
        for row, j in np.argwhere(~np.isin(approach, (-1.0, 0.0, 1.0)))[:1].tolist():
            raise table.fault(row, signs[j], "is not -1, 0 or +1")
        given, ties = [name in table.columns for name in signs], robot.ties.matrix.T
        together = np.abs(approach @ ties) == np.abs(approach) @ np.abs(ties)
        moved = np.sign(approach @ ties) * together  # unknown where those that move it oppose
        fields["approach"] = np.where(given, approach, moved)[rows]
    if "session" in table.columns:
        fields["session"] = np.array(table.names("session"))[rows]
    if "station" in table.columns:
        stations, station = np.unique(table.names("station"), return_inverse=True)
        fields["stations"], fields["station"] = tuple(stations.tolist()), station[rows]
    return fields


def _columns(table: CsvTable, names: Sequence[str]) -> Array:
    """Numbers of columns side by side, (rows, n); zeros for those that are not there."""
    none = np.zeros(len(table.rows))
    return np.column_stack([table.numbers(n) if n in table.columns else none for n in names])


def _of_joints(table: CsvTable, names: Sequence[str], driven: Sequence[bool]) -> Array | None:
    """Numbers of a column for each joint (rows, n); None where there are none.

    Raises InputError where only some of those with a drive have one.
    """
    wanted = [*itertools.compress(names, driven)]
    present = [name for name in wanted if name in table.columns]
    if present and len(present) < len(wanted):
        missing = next(name for name in wanted if name not in present)
        what = f"column {missing!r} is missing beside {present[0]!r}"
        raise InputError(table.path, "line 1", what, "give every joint's, or none")
    return _columns(table, names) if present else None
