"""Read measurements, plans and targets. Units stand in the column names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from calib.arrays import Array, IntArray
from calib.cell import Cell
from calib.errors import InputError
from calib.files.columns import (
    WRENCH,
    check_known,
    covariates,
    joint_columns,
    joint_values,
    shared_columns,
)
from calib.files.csv_table import CsvTable, columns_of, read_table
from calib.files.odd import (
    odd_cell,
    odd_joints,
    odd_readings,
    refuse_payload_and_wrench,
    refuse_radians,
    without_copies,
)
from calib.files.readings import reading_columns, reading_names, readings_of, sites_of
from calib.poses import Measurements, Poses, hung, poses_at
from calib.poses.moves import with_moves


def load_measurements(cell: Cell, path: str | Path, *, every_marker: bool = True) -> Measurements:
    """Read measured points, one row a point, into arrays with a mask for hidden markers.

    every_marker : refuse a table that never shows one of the cell's markers; False for held-out poses

    Raises InputError naming line and column for what is missing, doubled, contradictory or no
    number. What is odd but usable is listed in ``Measurements.warnings``. From which side each joint
    came follows from the order of measurement where the table does not say.
    """
    cell.check_poses()
    path = Path(path)
    warnings: list[str] = []

    def check(columns: tuple[str, ...]) -> None:
        warnings.extend(check_known(path, cell.robot, columns, reading_names(cell.instruments)))
        joint_columns(path, cell.robot, columns)
        if len(cell.instruments) == 1:
            reading_columns(path, cell.instruments[0], columns)

    table = read_table(path, ("pose", "marker"), check)
    q_rows = joint_values(table, cell.robot)
    named = table.names("pose")
    order = {name: i for i, name in enumerate(dict.fromkeys(named))}
    pose_of_row = np.array([order[name] for name in named])
    _, first = np.unique(pose_of_row, return_index=True)
    given = covariates(table, cell.robot, first)
    poses = with_moves(poses_at(q_rows[first], tuple(order), **given))
    _check_poses_agree(table, cell, pose_of_row, first)
    poses = replace(poses, site=sites_of(table, cell, pose_of_row, first))
    refuse_payload_and_wrench(cell, path, poses)
    readings, seen, sigma = readings_of(table, cell, pose_of_row, len(order))
    if every_marker:
        _refuse_unmeasured(table, cell)
    warnings += [*odd_cell(cell), *odd_joints(table, cell, q_rows)]
    warnings += odd_readings(path, cell, poses)
    data = Measurements(poses, readings, seen, sigma, tuple(warnings))
    return without_copies(table, cell, data, path)


def _refuse_unmeasured(table: CsvTable, cell: Cell) -> None:
    shown = set(table.text("marker"))
    for name in cell.read_names:
        if name in cell.marker_names and ":" not in name and name not in shown:
            table_of = "bodies" if name in cell.bodies else "markers_mm"
            what = f"is in the cell's [{table_of}] and never measured"
            remedy = "measure it or take it out of the cell"
            raise InputError(table.path, f"marker {name}", what, remedy)


def _check_poses_agree(table: CsvTable, cell: Cell, pose_of_row: IntArray, first: IntArray) -> None:
    """Rows of one pose must share joints, wrench, time and heat."""
    shared = shared_columns(cell.robot) - reading_names(cell.instruments)
    for name in (name for name in table.columns if name in shared):
        text = name in ("station", "session")
        values = np.array(table.text(name)) if text else table.numbers(name)
        for row in np.flatnonzero(values != values[first][pose_of_row])[:1].tolist():
            what = f"differs from the other rows of pose {table.text('pose')[row]!r}"
            raise table.fault(row, name, what, "rename the pose")


def _load_poses(cell: Cell, path: Path, required: Sequence[str]) -> tuple[Poses, CsvTable]:
    """Poses of a table."""

    def check(columns: tuple[str, ...]) -> None:
        check_known(path, cell.robot, columns, reading_names(cell.instruments))
        joint_columns(path, cell.robot, columns)

    table = read_table(path, required, check)
    q = joint_values(table, cell.robot)
    refuse_radians(table, cell.robot, q)
    rows = np.arange(len(q))
    given = covariates(table, cell.robot, rows)
    if "pose" in table.columns:
        given["names"] = tuple(table.names("pose"))
        table.refuse_twice("pose", "rename one of them")
    return poses_at(q, site=sites_of(table, cell, rows, rows), **given), table


def load_plan(cell: Cell, path: str | Path) -> Poses:
    """Read a plan: pose identifiers, joints, optional wrench, in the order of measurement.

    That is the order of its column ``order``, else of its lines: then it says nothing of when it is
    measured, and neither does the result.

    Raises InputError.
    """
    cell.check_poses()
    poses, table = _load_poses(cell, Path(path), ("pose",))
    if "order" not in table.columns:
        return replace(with_moves(poses), order=None)
    table.refuse_twice("order", "number the poses 1, 2, ..")
    return with_moves(poses.take(np.argsort(table.numbers("order"), kind="stable")))


def holds_points(path: str | Path) -> bool:
    """Whether a table has a column of markers: it is of measurements, not a plan."""
    return "marker" in columns_of(Path(path))


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
    if cell.load is not None and not any(name in table.columns for name in WRENCH):
        poses = hung(poses, cell.load.mass, cell.load.com)
    return poses, weights
