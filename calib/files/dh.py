"""Read and write DH tables: one row a joint, ``joint,alpha_deg,a_mm,theta_deg,d_mm``."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from calib.arm.dh import DhTable, robot_of_dh
from calib.arm.robot import Convention, Robot, Source
from calib.arrays import Array
from calib.errors import InputError
from calib.files.columns import ANGLES, LENGTHS, column_of, titles
from calib.files.csv_table import CsvTable, read_table

KINDS = ("revolute", "prismatic")
COLUMNS = {"alpha": ANGLES, "a": LENGTHS, "theta": ANGLES, "d": LENGTHS, "beta": ANGLES}
"""Each number of a row with its units; ``beta`` (Hayati) may be left out, and is 0."""

_MOST_JOINTS = 100
_TURNS = 2 * math.pi + 0.1  # rad: more is probably degrees
_LONGEST = 50.0  # m of a link: more is probably millimetres


def read_dh(path: Path, convention: Convention) -> DhTable:
    """A table in a convention that no file tells.

    Raises InputError for columns without unit, a joint twice, and units that cannot be meant.
    """
    found = read_table(
        path, ("joint",), lambda names: _check_columns(path, names), "joints", "write a number"
    )
    n = len(found.rows)
    if n > _MOST_JOINTS:
        raise InputError(path, "", f"has {n} joints, at most {_MOST_JOINTS} are possible")
    values = {}
    for name, known in COLUMNS.items():
        unit = next((u for u in known if f"{name}_{u}" in found.columns), None)
        values[name] = np.zeros(n)
        if unit is not None:
            values[name] = _checked(found, name, unit) * known[unit]
    found.refuse_twice("joint", "name each joint once")
    kinds = found.text("kind") if "kind" in found.columns else n * ["revolute"]
    for row, kind in enumerate(kinds):
        if kind not in KINDS:
            what = f"{kind[:40]!r} is not known"
            raise found.fault(row, "kind", what, f"use {' or '.join(KINDS)}")
    prismatic = np.array([kind == "prismatic" for kind in kinds])
    return DhTable(convention, tuple(found.names("joint")), prismatic, **values)


def load_dh(path: Path, convention: Convention, base: str, tip: str) -> Robot:
    """The chain of a table; ``base`` and ``tip`` are words for its first and last frame.

    Raises InputError.
    """
    robot = robot_of_dh(read_dh(path, convention), path.stem, base, tip)
    return replace(robot, source=Source("dh", (path,), convention))


def _check_columns(path: Path, columns: tuple[str, ...]) -> None:
    known = {"", "joint", "kind", *COLUMNS}
    known |= {title for name, own in COLUMNS.items() for title in titles(name, own)}
    for column in columns:
        if column not in known:
            remedy = "a DH table has joint, alpha_deg, a_mm, theta_deg, d_mm, and may have kind"
            raise InputError(path, "line 1", f"column {column!r} is none of a DH table", remedy)
    for name, own in COLUMNS.items():
        if column_of(path, columns, name, own, name) is None and name != "beta":
            remedy = f"add {' or '.join(titles(name, own))}"
            raise InputError(path, "line 1", f"has no column for {name}", remedy)


def _checked(found: CsvTable, name: str, unit: str) -> Array:
    """A column in its own unit. Raises InputError where another unit must be meant."""
    column = f"{name}_{unit}"
    values = found.numbers(column)
    other, looks = "", np.zeros(len(values), dtype=bool)
    if unit == "rad":
        other, looks = "degrees", np.abs(values) > _TURNS
    elif unit == "deg":  # nobody bends an axis by pi / 2 degrees
        right_angles = np.abs(values) / (math.pi / 2)
        near = np.abs(right_angles - np.round(right_angles)) < 1e-3
        other, looks = "radians", near & (np.round(right_angles) >= 1) & (right_angles < 2.5)
    elif unit == "m" and name == "a":
        other, looks = "millimetres", np.abs(values) > _LONGEST
    if looks.any():
        row = int(np.flatnonzero(looks)[0])
        right = {"degrees": "deg", "radians": "rad", "millimetres": "mm"}[other]
        what = f"{values[row]:.10g} looks like {other}"
        raise found.fault(row, column, what, f"name the column {name}_{right}")
    return values
