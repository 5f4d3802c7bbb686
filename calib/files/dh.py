"""Read DH tables: one row a joint, ``joint,alpha_deg,a_mm,theta_deg,d_mm``."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from calib.arm.dh import robot_of_dh
from calib.arm.robot import Convention, Robot, Source
from calib.arrays import Array
from calib.errors import InputError
from calib.files.columns import ANGLES, LENGTHS, column_of, titles
from calib.files.csv_table import CsvTable, read_table

_KINDS = ("revolute", "prismatic")
_COLUMNS = {"alpha": ANGLES, "a": LENGTHS, "theta": ANGLES, "d": LENGTHS, "beta": ANGLES}
_MOST_JOINTS = 100
_TURNS = 2 * math.pi + 0.1  # rad: more is probably degrees
_LONGEST = 50.0  # m of a link: more is probably millimetres


def load_dh(path: Path, convention: Convention, base: str, tip: str) -> Robot:
    """The chain of a table in a convention that no file tells.

    base, tip : words for its first and last frame

    Raises InputError for columns without unit, a joint twice, and units that cannot be meant.
    """
    table = read_table(
        path, ("joint",), lambda names: _check_columns(path, names), "joints", "write a number"
    )
    if len(table.rows) > _MOST_JOINTS:
        what = f"has {len(table.rows)} joints, at most {_MOST_JOINTS} are possible"
        raise InputError(path, "", what)
    table.refuse_twice("joint", "name each joint once")
    kinds = table.text("kind") if "kind" in table.columns else len(table.rows) * ["revolute"]
    for row, kind in enumerate(kinds):
        if kind not in _KINDS:
            what = f"{kind[:40]!r} is not known"
            raise table.fault(row, "kind", what, f"use {' or '.join(_KINDS)}")
    robot = robot_of_dh(
        convention,
        (path.stem, base, tip),
        tuple(table.names("joint")),
        np.array([kind == "prismatic" for kind in kinds]),
        **{name: _values(table, name, units) for name, units in _COLUMNS.items()},
    )
    return replace(robot, source=Source("dh", (path,), convention))


def _check_columns(path: Path, columns: tuple[str, ...]) -> None:
    known = {"", "joint", "kind", *_COLUMNS}
    known |= {title for name, units in _COLUMNS.items() for title in titles(name, units)}
    for column in columns:
        if column not in known:
            remedy = "a DH table has joint, alpha_deg, a_mm, theta_deg, d_mm, and may have kind"
            raise InputError(path, "line 1", f"column {column!r} is none of a DH table", remedy)
    for name, units in _COLUMNS.items():
        if column_of(path, columns, name, units, name) is None and name != "beta":
            remedy = f"add {' or '.join(titles(name, units))}"
            raise InputError(path, "line 1", f"has no column for {name}", remedy)


def _values(table: CsvTable, name: str, units: dict[str, float]) -> Array:
    """A number of each row, SI. Raises InputError where another unit must be meant."""
    unit = next((u for u in units if f"{name}_{u}" in table.columns), None)
    if unit is None:
        return np.zeros(len(table.rows))
    column = f"{name}_{unit}"
    values = table.numbers(column)
    quarters = np.abs(values) / (math.pi / 2)
    whole = np.round(quarters)
    looks = {  # nobody bends an axis by pi / 2 degrees
        "rad": ("degrees", "deg", np.abs(values) > _TURNS),
        "deg": ("radians", "rad", (np.abs(quarters - whole) < 1e-3) & (whole >= 1) & (whole < 3)),
        "m": ("millimetres", "mm", (np.abs(values) > _LONGEST) & (name == "a")),
        "mm": ("", "", np.zeros(len(values), dtype=bool)),
    }
    other, right, wrong = looks[unit]
    for row in np.flatnonzero(wrong)[:1].tolist():
        what = f"{values[row]:.10g} looks like {other}"
        raise table.fault(row, column, what, f"name the column {name}_{right}")
    return values * units[unit]
