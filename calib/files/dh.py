"""Read DH tables: one row a joint, ``joint,alpha_deg,a_mm,theta_deg,d_mm``.

A joint is ``J = Rz(theta) Tz(d)``, with the joint's own motion added to theta or d. A link is ``L =
Tx(a) Rx(alpha)``. A row of the convention ``classic`` (Paul) is ``J L``, the link beyond its joint; one
of ``modified`` (Craig) is ``L J``, the link before its joint. Each joint's own motion commutes with its
J: the frame of a modified joint is that of its row, the frame of a classic one that of the row before.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from calib.arm.robot import Convention, Robot, Source
from calib.arm.se3 import transform
from calib.arrays import Array
from calib.errors import InputError
from calib.files.columns import ANGLES, LENGTHS, Column, column_of, titles
from calib.files.csv_table import CsvTable, read_table

_KINDS = ("revolute", "prismatic")
_COLUMNS = {"alpha": ANGLES, "a": LENGTHS, "theta": ANGLES, "d": LENGTHS}
_TURNS = 2 * math.pi + 0.1  # rad: more is probably degrees


def load_dh(path: Path, convention: Convention, base: str, tip: str) -> Robot:
    """The chain of a table in a convention that no file tells.

    base, tip : words for its first and last frame

    Raises InputError for columns without unit, a joint twice, and units that cannot be meant.
    """
    found = dict[str, Column]()
    table = read_table(
        path,
        ("joint",),
        lambda names: found.update(_columns(path, names)),
        "joints",
        "write a number",
    )
    table.refuse_twice("joint", "name each joint once")
    kinds = table.text("kind") if "kind" in table.columns else len(table.rows) * ["revolute"]
    for row, kind in enumerate(kinds):
        if kind not in _KINDS:
            what = f"{kind[:40]!r} is not known"
            raise table.fault(row, "kind", what, f"use {' or '.join(_KINDS)}")
    alpha, a, theta, d = (_values(table, name, found[name]) for name in _COLUMNS)
    zero, end = np.zeros_like(a), np.eye(4)[None]
    links = transform(_about(0, alpha), np.stack([a, zero, zero], axis=-1))
    moved = transform(_about(2, theta), np.stack([zero, zero, d], axis=-1))
    if convention == "classic":
        origins = np.concatenate([end, moved @ links])
    else:
        origins = np.concatenate([links @ moved, end])
    slides = np.array([kind == "prismatic" for kind in kinds])
    names = tuple(table.names("joint"))
    robot = Robot.of_geometry(path.stem, (base, tip), names, slides, origins)
    return replace(robot, source=Source("dh", (path,), convention))


def _columns(path: Path, columns: tuple[str, ...]) -> Iterator[tuple[str, Column]]:
    """The column of each number. Raises InputError."""
    known = {"", "joint", "kind", *_COLUMNS}
    known |= {title for name, units in _COLUMNS.items() for title in titles(name, units)}
    for column in columns:
        if column not in known:
            remedy = "a DH table has joint, alpha_deg, a_mm, theta_deg, d_mm, and may have kind"
            raise InputError(path, "line 1", f"column {column!r} is none of a DH table", remedy)
    for name, units in _COLUMNS.items():
        if (found := column_of(path, columns, name, units, name)) is None:
            remedy = f"add {' or '.join(titles(name, units))}"
            raise InputError(path, "line 1", f"has no column for {name}", remedy)
        yield name, found


def _values(table: CsvTable, name: str, column: Column) -> Array:
    """A number of each row, SI. Raises InputError where another unit must be meant."""
    values, unit = table.numbers(column.name), column.name.rpartition("_")[2]
    quarters = np.abs(values) / (math.pi / 2)
    whole = np.round(quarters)
    looks = {  # nobody bends an axis by pi / 2 degrees
        "rad": ("degrees", "deg", np.abs(values) > _TURNS),
        "deg": ("radians", "rad", (np.abs(quarters - whole) < 1e-3) & (whole >= 1) & (whole < 3)),
    }
    other, right, wrong = looks.get(unit, ("", "", np.zeros(len(values), dtype=bool)))
    for row in np.flatnonzero(wrong)[:1].tolist():
        what = f"{values[row]:.10g} looks like {other}"
        raise table.fault(row, column.name, what, f"name the column {name}_{right}")
    return values * column.scale


def _about(i: int, angle: Array) -> Array:
    """Rotations about a coordinate axis, whose right angles are exact to the last digit but one."""
    j, k = (i + 1) % 3, (i + 2) % 3
    R = np.zeros((*np.shape(angle), 3, 3))
    R[..., i, i] = 1.0
    R[..., j, j] = R[..., k, k] = np.cos(angle)
    R[..., k, j] = np.sin(angle)
    R[..., j, k] = -R[..., k, j]
    return R
