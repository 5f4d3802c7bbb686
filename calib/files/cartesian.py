"""Targets as poses of the tip: columns in millimetres and a quaternion become nominal joint values."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from calib.arm.inverse import solutions
from calib.arm.robot import Robot
from calib.arrays import Array
from calib.errors import InputError
from calib.files.columns import ANGLES, LENGTHS
from calib.files.csv_table import CsvTable

QUATERNION = ("qw", "qx", "qy", "qz")
_AS_LONG = 1e-3  # from one: a quaternion that was rounded
_LEAP = np.pi / 2.0  # of a joint that turns, between two targets


def is_cartesian(robot: Robot, columns: tuple[str, ...]) -> bool:
    """Whether a table of targets has places of the tip, and no joints."""
    names = robot.joints
    joints = {*names} | {f"{j}_{u}" for j in names for u in (*ANGLES, *LENGTHS)}
    return not joints & set(columns) and any(f"x_{unit}" in columns for unit in LENGTHS)


def cartesian_columns(path: Path, columns: tuple[str, ...]) -> tuple[tuple[str, ...], float]:
    """Columns of the place, and their unit in m. Raises InputError where any is missing."""
    unit = next(unit for unit in LENGTHS if f"x_{unit}" in columns)
    place = tuple(f"{axis}_{unit}" for axis in "xyz")
    for name in (*place, *QUATERNION):
        if name not in columns:
            what = f"targets of the tip lack column {name}"
            raise InputError(path, "line 1", what, f"add {name}, base frame")
    return place, LENGTHS[unit]


def tip_joints(table: CsvTable, robot: Robot) -> Array:
    """Joint values of the nominal robot at every row, shape (rows, n), rad or m.

    At the first row the solution nearest to the middle of the joint ranges, at others the one nearest
    to the row before. Raises InputError, naming the line, where a tip is out of reach.
    """
    from scipy.spatial.transform import Rotation

    place, unit = cartesian_columns(table.path, table.columns)
    o = np.column_stack([table.numbers(name) for name in place]) * unit
    wxyz = np.column_stack([table.numbers(name) for name in QUATERNION])
    for row in np.flatnonzero(np.abs(np.linalg.norm(wxyz, axis=1) - 1.0) > _AS_LONG)[:1]:
        what = f"the quaternion's length is {np.linalg.norm(wxyz[row]):.4g}, not 1"
        raise table.fault(int(row), "qw", what, "check its four numbers")
    R = Rotation.from_quat(wxyz[:, [1, 2, 3, 0]]).as_matrix().reshape(-1, 3, 3)
    chosen = [robot.sample_limits().mean(axis=1)]
    for row, tip in enumerate(solutions(robot, R, o)):
        if not len(tip.q):
            left = f"{tip.short * 1e3:.1f} mm and {np.degrees(tip.turned):.2f} deg are left"
            what = f"the nominal arm does not reach this tip within its limits: {left}"
            remedy = "is it in the robot's base frame, and of the cell's tip?"
            raise table.fault(row, place[0], what, remedy)
        chosen.append(tip.nearest(robot, chosen[-1]))
    return np.array(chosen[1:]).reshape(-1, robot.dof)


def solution_said(robot: Robot, names: tuple[str, ...], q: Array) -> tuple[str, ...]:
    """Which solution was taken where targets were poses of the tip, q (m, n)."""
    if not len(q):
        return ()
    shown = ", ".join(f"{name} {value:.1f}" for name, value in robot.shown(q[0]).items())
    said = [
        f"tip poses were turned into joints: at {names[0]} the solution nearest to the middle of the "
        f"joint ranges, {shown}; at the others the one nearest to the target before"
    ]
    leaps = np.flatnonzero((np.abs(np.diff(q, axis=0)) * ~robot.prismatic > _LEAP).any(axis=1))
    if len(leaps):
        several = f" and {len(leaps) - 1} more" if len(leaps) > 1 else ""
        said.append(
            f"a joint turns by more than 90 deg on the way to {names[leaps[0] + 1]}{several}: the arm "
            "may change its solution there"
        )
    return tuple(said)
