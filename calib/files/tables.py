"""Read measurements, plans and targets. Units stand in the column names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from calib.arm.robot import Robot
from calib.arrays import Array, IntArray
from calib.cell import Cell
from calib.errors import InputError
from calib.files.columns import (
    OTHERS,
    WRENCH,
    check_known,
    covariates,
    joint_columns,
    joint_values,
    joint_warnings,
    point_columns,
    torque_columns,
)
from calib.files.csv_table import LONGEST_LINE, Table, read_table
from calib.files.payload_twice import refuse_payload_twice
from calib.poses import Measurements, Poses, hung, poses_at
from calib.poses.moves import with_moves

_FARTHEST = 1e4  # m: no instrument of this trade reads as far


def load_measurements(cell: Cell, path: str | Path, *, every_marker: bool = True) -> Measurements:
    """Read measured points, one row a point, into arrays with a mask for hidden markers.

    every_marker : refuse a table that never shows one of the cell's markers; False for held-out poses

    Raises InputError naming line and column for what is missing, doubled, contradictory or no
    number. What is odd but usable is listed in ``Measurements.warnings``. From which side each joint
    came follows from the order of measurement where the table does not say.
    """
    path = Path(path)
    warnings: list[str] = []

    def check(columns: tuple[str, ...]) -> None:
        warnings.extend(check_known(path, cell.robot, columns))
        joint_columns(path, cell.robot, columns)
        point_columns(path, columns)

    table = read_table(path, ("pose", "marker"), check)
    q_rows = joint_values(table, cell.robot)
    warnings.extend(joint_warnings(table, cell.robot, q_rows))
    pose_names, pose_of_row = _number_in_order(table.names("pose"))
    marker_of_row = _markers(table, cell)
    _, first = np.unique(pose_of_row, return_index=True)
    given = covariates(table, cell.robot, first)
    poses = with_moves(poses_at(q_rows[first], pose_names, **given))
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
    refuse_payload_twice(cell, path, poses)
    columns = point_columns(path, table.columns)
    xyz = np.column_stack([table.numbers(name) * scale for name, scale in columns])
    if (far := np.abs(xyz) > _FARTHEST).any():
        row, column = (int(i[0]) for i in np.nonzero(far))
        what = f"{table.rows[row][table.columns.index(columns[column][0])]} is farther than 10 km"
        raise table.fault(row, columns[column][0], what, "check the reading and its unit")
    points[pose_of_row, marker_of_row] = xyz
    if "sigma_mm" in table.columns:
        own = table.numbers("sigma_mm") * 1e-3
        if (own <= 0).any():
            raise table.fault(
                int(np.flatnonzero(own <= 0)[0]),
                "sigma_mm",
                "must be above zero",
                "leave the column out for the cell's",
            )
        sigma[pose_of_row, marker_of_row] = own
    for j in np.flatnonzero(~seen.any(axis=0)) if every_marker else ():
        raise InputError(
            path,
            f"marker {cell.marker_names[j]}",
            "is in the cell's [markers_mm] and never measured",
            "measure it or take it out of the cell",
        )
    if cell.load is not None and not poses.wrench.any() and poses.configuration.max() + 1 < m:
        warnings.append(
            f"{path}: no reading bears a load, though joints repeat and the cell has a [load]; that "
            "one is for plans: readings under load need columns fx_N .. mz_Nm"
        )
    return Measurements(poses, points, seen, sigma, tuple(warnings))


def _number_in_order(
    names: list[str],
) -> tuple[tuple[str, ...], IntArray]:
    """Distinct names in order of appearance, and the position of each row's name."""
    order = {name: i for i, name in enumerate(dict.fromkeys(names))}
    return tuple(order), np.array([order[name] for name in names])


def _markers(table: Table, cell: Cell) -> IntArray:
    numbers = {name: i for i, name in enumerate(cell.marker_names)}
    names = table.text("marker")
    for row, name in enumerate(names):
        if name not in numbers:
            known = f"markers are {', '.join(cell.marker_names[:12])}"
            raise table.fault(row, "marker", f"{name!r} is not in the cell's [markers_mm]", known)
    return np.array([numbers[name] for name in names])


def _check_poses_agree(
    table: Table,
    robot: Robot,
    pose_of_row: IntArray,
    first: IntArray,
) -> None:
    """Rows of one pose must share joints, wrench, time and heat."""
    own = {"marker", "sigma_mm", *(f"{a}_{u}" for a in "xyz" for u in ("mm", "m"))}
    units = ("deg", "rad", "mm", "m")
    shared = {*OTHERS, *WRENCH, *(f"{j}_{u}" for j in robot.joints for u in units)}
    shared |= {f"approach_{j}" for j in robot.joints} | set(torque_columns(robot))
    for name in table.columns:
        if name in shared - own - {"pose"}:
            text = name in ("station", "pose")
            values = np.array(table.text(name)) if text else table.numbers(name)
            bad = np.flatnonzero(values != values[first][pose_of_row])
            if len(bad):
                row = int(bad[0])
                pose = table.text("pose")[row]
                raise table.fault(
                    row, name, f"differs from the other rows of pose {pose!r}", "rename the pose"
                )


def _load_poses(cell: Cell, path: Path, required: Sequence[str]) -> tuple[Poses, Table]:
    warnings: list[str] = []

    def check(columns: tuple[str, ...]) -> None:
        warnings.extend(check_known(path, cell.robot, columns))
        joint_columns(path, cell.robot, columns)

    table = read_table(path, required, check)
    q = joint_values(table, cell.robot)
    given = covariates(table, cell.robot, np.arange(len(q)))
    if "pose" in table.columns:
        names = table.names("pose")
        known: set[str] = set()
        for row, name in enumerate(names):
            if name in known:
                raise table.fault(row, "pose", f"{name!r} stands twice", "rename one of them")
            known.add(name)
        given["names"] = tuple(names)
    return poses_at(q, **given), table


def load_plan(cell: Cell, path: str | Path) -> Poses:
    """Read a plan: pose identifiers, joints, optional wrench, in the order of measurement.

    Raises InputError.
    """
    poses, _ = _load_poses(cell, Path(path), ("pose",))
    return replace(with_moves(poses), order=None)  # a plan says nothing of when it is measured


def holds_points(path: str | Path) -> bool:
    """Whether a table has a column of markers: it is of measurements, not a plan."""
    try:
        with Path(path).open(encoding="utf-8-sig") as file:
            first = file.readline(LONGEST_LINE)
    except (OSError, ValueError):
        return False  # whoever reads the table says what is wrong with it
    return "marker" in [name.strip() for name in first.split(",")]


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
