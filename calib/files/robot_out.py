"""The identified robot in any form: URDF, MJCF, DH table, a maker's file, offsets of its joints."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.arm.kinematics import tip_points
from calib.arm.robot import Convention, Form, Robot, Source
from calib.arm.se3 import fit_rigid, transformed
from calib.arrays import Array, IntArray
from calib.cell import Cell
from calib.effects.base import Base
from calib.effects.protocol import Constant
from calib.effects.tool import Tool
from calib.errors import InputError
from calib.files.csv_table import columns_text
from calib.files.dh_out import corrected_dh, dh_lacks
from calib.files.kinematics import corrected_kinematics, kinematics_lacks, kinematics_of
from calib.files.mjcf_out import corrected_mjcf, mjcf_of_urdf
from calib.files.robot import load_robot
from calib.files.urdf_out import chain_urdf, corrected_urdf
from calib.model import Model

LACKS: dict[Form, str] = {
    "urdf": "the bare chain, without shapes and moments of inertia",
    "mjcf": "without shapes",
    "dh": "without limits, efforts, masses and shapes",
    "kinematics": "without limits, efforts, masses and shapes",
}
"""What a robot has not in this form that it may have in the one that it is made from."""

_MIMICS: dict[Form, str] = {
    "mjcf": "couples joints by an equality, which posecal reads from a URDF only",
    "dh": "does not say which joints mimic others",
    "kinematics": "does not say which joints mimic others",
}


@dataclass(frozen=True)
class Written:
    """A robot as text, and what it does not hold: each a line about the file."""

    text: str
    lacks: tuple[str, ...]


def corrected_robot(
    cell: Cell,
    form: Form,
    corrections: Array,
    markers: dict[str, Array],
    target: Path,
    convention: Convention | None = None,
) -> Written:
    """The robot with the identified geometry, in one of the forms that a cell may name.

    In its own form the user's file is kept but for the corrected numbers. An MJCF, a DH table or a
    kinematics file as URDF is the bare chain with the limits and masses that there are.

    corrections, markers, target : as for :func:`~calib.files.mjcf_out.corrected_mjcf`
    convention : of a DH table; the cell's own, else classic

    Raises InputError where the file cannot be read any more, where MuJoCo is needed and missing, and
    for an arm whose maker has no kinematics file.
    """
    lacks = []
    if cell.robot.branched and form != cell.robot.source.form:
        what, tips = f"a {Source(form)} made anew has one tip", ", ".join(cell.robot.tips)
        remedy = f"write it as the robot's own form, {cell.robot.source}"
        raise InputError(target, "", f"{what}, and this robot has {tips}", remedy)
    if form != cell.robot.source.form:
        lacks.append(f"is made anew from the {cell.robot.source}: {LACKS[form]}")
        lacks += [f"{_MIMICS[form]}: {m.joint} by {m.master}" for m in cell.robot.mimics]
    if form == "dh":
        convention = convention or cell.robot.source.convention or "classic"
        fit, text = corrected_dh(cell, corrections, convention)
        notes = dh_lacks(fit, cell.robot, markers)
        return Written(text, (*lacks, f"is {convention}; name it so in the cell", *notes))
    if form == "kinematics":
        own = cell.robot.source.form == "kinematics"
        text = (
            corrected_kinematics(cell.robot_files[0], corrections)
            if own
            else kinematics_of(cell.robot, corrections)
        )
        return Written(text, (*lacks, *kinematics_lacks(cell.robot, corrections, own)))
    source, robot = cell.robot_files[0], cell.robot
    links = dict(zip(cell.marker_names, cell.marker_links, strict=False))
    if form == robot.source.form == "mjcf":
        return Written(corrected_mjcf(source, robot, corrections, markers, target, links), ())
    if robot.source.form == "urdf":
        text = corrected_urdf(source, robot, corrections, markers, links)
    elif robot.source.form == "mjcf":  # limits as in the file
        whole = load_robot("mjcf", source, robot.base, robot.tip)
        text = chain_urdf(whole, corrections, markers)
    else:
        text = chain_urdf(robot, corrections, markers)
    if form == "mjcf":
        text = mjcf_of_urdf(source, text, robot.tip)
    return Written(text, tuple(lacks))


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
