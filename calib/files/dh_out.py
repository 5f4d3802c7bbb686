"""The identified geometry as a DH table, and what no table says of the arm."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib.arm.dh import DhFit, dh_of_robot, robot_of_dh
from calib.arm.kinematics import tip_points
from calib.arm.robot import Convention, Robot
from calib.arm.se3 import so3_log, transformed
from calib.arrays import Array
from calib.cell import Cell
from calib.files.dh import dh_text, read_dh

_SAME = 1e-9  # m or rad
_POSES = 128


def corrected_dh(cell: Cell, corrections: Array, convention: Convention) -> tuple[DhFit, str]:
    """The table with the identified geometry, and its text.

    A cell's own table keeps its units, and its numbers where nothing was found.

    corrections : ndarray, shape (n + 2, 6), m and rad, displacement of each frame as in
        :class:`~calib.arm.robot.Robot`

    Raises InputError where the cell's table cannot be read any more.
    """
    if cell.robot.source.convention != convention:
        fit = dh_of_robot(cell.robot, corrections, convention)
        return fit, dh_text(fit.table)
    own = read_dh(cell.robot_files[0], convention)
    fit = dh_of_robot(cell.robot, corrections, own.table)
    return fit, dh_text(fit.table, own.units)


def dh_lacks(fit: DhFit, robot: Robot, markers: dict[str, Array]) -> list[str]:
    """What the table does not say of the arm, each with its size.

    markers : dict, name -> ndarray, shape (3,), m, tip frame
    """
    lacks = []
    if np.abs(fit.T_base - np.eye(4)).max() >= _SAME:
        lacks.append(f"its first frame stands in {robot.base} at {_pose(fit.T_base)}")
    if np.abs(fit.T_tip - np.eye(4)).max() >= _SAME:
        places = {name: _mm(transformed(fit.T_tip, p)) for name, p in markers.items()}
        listed = "".join(f"; {name} is at {place} there" for name, place in places.items())
        lacks.append(f"{robot.tip} stands in its last frame at {_pose(fit.T_tip)}{listed}")
    tilted = [j for j, b in zip(fit.table.joints, fit.table.beta, strict=True) if abs(b) > _SAME]
    if tilted:
        lacks.append(
            f"beta (Hayati) at {', '.join(tilted)}: a tilt between nearly parallel axes that no table "
            f"of DH alone has; without it, off by up to {_without_beta(fit, robot, markers)}"
        )
    return lacks


def _without_beta(fit: DhFit, robot: Robot, markers: dict[str, Array]) -> str:
    """Largest distance by which the markers move where beta is left out."""
    q = robot.sobol(_POSES)
    plain = replace(fit.table, beta=np.zeros(robot.dof))
    tool = np.array(list(markers.values()) or [np.zeros(3)])
    tool = transformed(fit.T_tip, tool)
    points = [
        tip_points(robot_of_dh(table, "", "base", "tip"), q, tool) for table in (fit.table, plain)
    ]
    return f"{np.linalg.norm(points[1] - points[0], axis=-1).max() * 1e3:.3g} mm at the markers"


def _pose(T: Array) -> str:
    turn = np.degrees(so3_log(T[:3, :3])) + 0.0
    turned = "" if np.abs(turn).max() < np.degrees(_SAME) else f", turned by ({_words(turn)}) deg"
    return _mm(T[:3, 3]) + turned


def _mm(point: Array) -> str:
    return f"({_words(point * 1e3)}) mm"


def _words(values: Array) -> str:
    return ", ".join(f"{value + 0.0:.5f}".rstrip("0").rstrip(".") for value in np.round(values, 5))
