"""Corrected commands as a table: that of the targets, which reads back as a plan and as targets."""

from __future__ import annotations

import math
from pathlib import Path

from calib.cell import Cell
from calib.compensation.commands import Compensation
from calib.errors import InputError
from calib.files.cartesian import is_cartesian
from calib.files.columns import joint_columns
from calib.files.csv_table import Table, read_table
from calib.files.write_tables import csv_text, joint_header

_MM = 1e3
_CHANGE = "change"


def nominal_table(cell: Cell, path: Path) -> Table:
    """The table of targets as text. Raises InputError, also for one that was corrected before."""

    def check(columns: tuple[str, ...]) -> None:
        for joint in cell.robot.joints:
            if any(name.startswith(f"{_CHANGE}_{joint}_") for name in columns):
                raise InputError(
                    path,
                    "line 1",
                    "holds corrected commands already",
                    "give the nominal targets, or take out the columns of changes",
                )

    return read_table(path, (), check)


def compensated_csv(cell: Cell, table: Table, found: Compensation) -> str:
    """The targets' own table with corrected joints, in its own units, and columns for what changed.

    table : Table, the targets that were compensated
    """
    if is_cartesian(cell.robot, table.columns):
        header = joint_header(cell.robot)
        named = joint_columns(table.path, cell.robot, tuple(header))
    else:
        named = joint_columns(table.path, cell.robot, table.columns)
    joints = {
        column.name: [f"{value:.9g}" for value in column.numbers(q)]
        for column, q in zip(named, found.q.T, strict=True)
    }
    columns = {"pose": list(found.targets.names), **joints}
    columns |= {name: joints.get(name) or table.text(name) for name in table.columns}
    columns |= _added(cell, found)
    return csv_text(list(columns), zip(*columns.values(), strict=True))


def _added(cell: Cell, found: Compensation) -> dict[str, list[str]]:
    """Change of each joint, and errors at the target before and after."""
    columns = {}
    for joint, slides, change in zip(
        cell.robot.joints, cell.robot.prismatic, found.correction.T, strict=True
    ):
        unit, scale = ("um", 1e-6) if slides else ("mdeg", math.pi / 180e3)
        columns[f"{_CHANGE}_{joint}_{unit}"] = [f"{value / scale:.3f}" for value in change]
    for name, errors in (
        ("before", found.before),
        ("left", found.left),
        ("expected", found.expected),
    ):
        columns[f"{name}_mm"] = [f"{value * _MM:.5f}" for value in errors]
    columns["limited_by"] = list(found.limited_by)
    return columns
