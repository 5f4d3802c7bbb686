"""The identified robot as URDF, and as offsets of its joints."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.arm.kinematics import tip_points
from calib.arm.robot import Robot
from calib.arm.se3 import fit_rigid, transformed
from calib.arrays import Array, IntArray
from calib.cell import Cell
from calib.effects.base import Base
from calib.effects.protocol import Constant
from calib.effects.tool import Tool
from calib.errors import InputError
from calib.files.csv_table import columns_text
from calib.files.robot import load_robot
from calib.files.urdf_out import chain_urdf, corrected_urdf
from calib.model import Model


@dataclass(frozen=True)
class Written:
    """A robot as text, and what it does not hold: each a line about the file."""

    text: str
    lacks: tuple[str, ...]


def corrected_robot(
    cell: Cell, corrections: Array, markers: dict[str, Array], target: Path
) -> Written:
    """The robot with the identified geometry as URDF.

    The user's own URDF is kept but for the corrected numbers. Of an MJCF or a DH table it is the bare
    chain with the limits and masses that there are.

    corrections, markers : as for :func:`~calib.files.urdf_out.corrected_urdf`

    Raises InputError where the file cannot be read any more, and for a tree of another form.
    """
    source, robot = cell.robot_files[0], cell.robot
    if robot.source.form == "urdf":
        links = dict(zip(cell.marker_names, cell.marker_links, strict=False))
        return Written(corrected_urdf(source, robot, corrections, markers, links), ())
    if robot.branched:
        what = f"a URDF made anew has one tip, and this robot has {', '.join(robot.tips)}"
        raise InputError(target, "", what, "name the robot's URDF in the cell")
    if robot.source.form == "mjcf":  # limits as in the file
        robot = load_robot("mjcf", source, robot.base, robot.tip)
    lack = f"is made anew from the {cell.robot.source}: the bare chain, without shapes and moments"
    return Written(chain_urdf(robot, corrections, markers), (f"{lack} of inertia",))


def not_rigid(model: Model) -> list[str]:
    """Effects ``name:where`` of a model that no rigid robot can hold."""
    rigid = (Constant, Base, Tool)
    return [f"{e.kind}:{e.where}" for e in model.effects if not isinstance(e, rigid)]


_POSES = 128


@dataclass(frozen=True, eq=False)
class ZeroOffsets:
    """What of a corrected geometry lies along the joints' own axes.

    offsets : ndarray, shape (n,), rad or m, ``q_true = q_read + offset``
    before, after : float, m, 3-D RMS by which the markers of the nominal arm miss those of the
        corrected one, the base fitted, without and with the offsets
    """

    offsets: Array
    before: float
    after: float


def zero_offsets(robot: Robot, corrections: Array, markers: Array, frames: IntArray) -> ZeroOffsets:
    """The offsets of a geometry, and how much of it they are, over Sobol poses within the limits.

    corrections : ndarray, shape (F, 6), m and rad, as in :class:`~calib.arm.robot.Robot`
    markers : ndarray, shape (M, 3), m, in the frames (M,) of their tips
    """
    own = corrections[1 : robot.dof + 1]
    along = np.where(robot.prismatic[:, None], own[:, :3], own[:, 3:])
    offsets = np.einsum("ki,ki->k", along, robot.axes)
    q = robot.sobol(_POSES)
    true = tip_points(robot, q, markers, corrections, frames)
    missed = []
    for tried in (q, q + offsets):
        points = tip_points(robot, tried, markers, frames=frames)
        off = transformed(fit_rigid(true.reshape(-1, 3), points.reshape(-1, 3)), points) - true
        missed.append(float(np.sqrt(np.mean(np.sum(off**2, axis=-1)))))
    return ZeroOffsets(offsets, *missed)


def zero_offsets_csv(
    robot: Robot, found: ZeroOffsets, counts_per_deg: dict[str, float] | None = None
) -> str:
    """The text of the table, a row a joint.

    ``reads_at_zero`` is what the controller shows where the joint truly is at zero. With encoder counts
    a degree (signed: rising with the joint's angle) ``master_count_change`` is to be added to FANUC's
    ``$MASTER_COUN``, as ``angle = (count - $MASTER_COUN) / counts a degree``.

    Raises InputError for counts of a joint that does not turn, or is not there.
    """
    counts = counts_per_deg or {}
    for name in counts:
        if name not in robot.joints or robot.prismatic[robot.joints.index(name)]:
            turning = [j for j, p in zip(robot.joints, robot.prismatic, strict=True) if not p]
            what = f"no joint {name!r} that turns"
            raise InputError("--counts-per-deg", "", what, f"use {', '.join(turning)}")
    shown = np.where(robot.prismatic, found.offsets * 1e3, np.degrees(found.offsets))
    columns = {
        "joint": list(robot.joints),
        "offset": [f"{value + 0.0:.9g}" for value in shown],
        "reads_at_zero": [f"{-value + 0.0:.9g}" for value in shown],
        "unit": ["mm" if slides else "deg" for slides in robot.prismatic],
    }
    if counts:
        columns["master_count_change"] = [
            f"{-value * counts[joint]:.0f}" if joint in counts else ""
            for joint, value in zip(robot.joints, shown, strict=True)
        ]
    return columns_text(columns)
