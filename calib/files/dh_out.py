"""Write the corrected robot as a DH table, and say what such a table cannot hold."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib.arm.dh import robot_of_dh
from calib.arm.dh_fit import DhFit, dh_of_robot
from calib.arm.kinematics import forward
from calib.arm.robot import Convention, Robot
from calib.arm.se3 import rotate, so3_log
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
    if not _is_identity(fit.T_base):
        lacks.append(f"its first frame stands in {robot.base} at {_pose(fit.T_base)}")
    if not _is_identity(fit.T_tip):
        places = {
            name: rotate(fit.T_tip[:3, :3], p) + fit.T_tip[:3, 3] for name, p in markers.items()
        }
        listed = "".join(f"; {name} is at {_mm(p)} there" for name, p in places.items())
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
    from scipy.stats import qmc

    low, high = robot.sample_limits().T
    q = robot.tied(low + (high - low) * qmc.Sobol(robot.dof, rng=0).random(_POSES))
    plain = replace(fit.table, beta=np.zeros(robot.dof))
    tool = np.array(list(markers.values()) or [np.zeros(3)])
    tool = rotate(fit.T_tip[:3, :3], tool) + fit.T_tip[:3, 3]
    points = []
    for table in (fit.table, plain):
        frames = forward(robot_of_dh(table, "", "base", "tip"), q)
        points.append(rotate(frames.R[:, None, -1], tool) + frames.o[:, None, -1])
    return f"{np.linalg.norm(points[1] - points[0], axis=-1).max() * 1e3:.3g} mm at the markers"


def _is_identity(T: Array) -> bool:
    return bool(np.abs(T - np.eye(4)).max() < _SAME)


def _pose(T: Array) -> str:
    turn = np.degrees(so3_log(T[:3, :3])) + 0.0
    turned = "" if np.abs(turn).max() < np.degrees(_SAME) else f", turned by ({_words(turn)}) deg"
    return _mm(T[:3, 3]) + turned


def _mm(point: Array) -> str:
    return f"({_words(point * 1e3)}) mm"


def _words(values: Array) -> str:
    return ", ".join(f"{value + 0.0:.5f}".rstrip("0").rstrip(".") for value in np.round(values, 5))
