"""Write the corrected robot in any form, from any form, and say what the form does not hold."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from calib.arm.robot import Convention, Form
from calib.arrays import Array
from calib.cell import Cell
from calib.effects.base import Base
from calib.effects.protocol import Constant
from calib.effects.tool import Tool
from calib.files.chain_urdf import chain_urdf
from calib.files.dh_out import corrected_dh, dh_lacks
from calib.files.kinematics import corrected_kinematics, kinematics_lacks, kinematics_of
from calib.files.mjcf_out import corrected_mjcf
from calib.files.robot import load_robot
from calib.files.urdf_out import corrected_urdf
from calib.files.urdf_to_mjcf import mjcf_of_urdf
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
    return Written(_tree(cell, form, corrections, markers, target), tuple(lacks))


def _tree(
    cell: Cell, form: Form, corrections: Array, markers: dict[str, Array], target: Path
) -> str:
    """The text of a URDF or an MJCF."""
    source = cell.robot_files[0]
    if cell.robot.source.form == "urdf":
        text = corrected_urdf(source, cell.robot, corrections, markers)
        return text if form == "urdf" else mjcf_of_urdf(source, text, cell.robot.tip)
    if cell.robot.source.form == "mjcf":
        if form == "mjcf":
            return corrected_mjcf(source, cell.robot, corrections, markers, target)
        whole = load_robot("mjcf", source, cell.robot.base, cell.robot.tip)  # limits as in the file
        return chain_urdf(whole, corrections, markers)
    text = chain_urdf(cell.robot, corrections, markers)
    return text if form == "urdf" else mjcf_of_urdf(source, text, cell.robot.tip)


def not_rigid(model: Model) -> list[str]:
    """Effects ``name:where`` of a model that no rigid robot can hold."""
    rigid = (Constant, Base, Tool)
    return [f"{e.kind}:{e.where}" for e in model.effects if not isinstance(e, rigid)]
