"""Write the corrected robot in either form, from either form."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from calib.arrays import Array
from calib.cell import Cell
from calib.effects.base import Base
from calib.effects.protocol import Constant
from calib.effects.tool import Tool
from calib.files.chain_urdf import chain_urdf
from calib.files.mjcf_out import corrected_mjcf
from calib.files.robot import load_robot
from calib.files.urdf_out import corrected_urdf
from calib.files.urdf_to_mjcf import mjcf_of_urdf
from calib.model import Model

Form = Literal["urdf", "mjcf"]

LACKS = {
    ("urdf", "mjcf"): "without shapes",
    ("mjcf", "urdf"): "the bare chain, without shapes and moments of inertia",
}
"""What a robot has not in the second form that it may have in the first."""


def corrected_robot(
    cell: Cell, form: Form, corrections: Array, markers: dict[str, Array], target: Path
) -> str:
    """The text of the robot with the identified geometry, as URDF or MJCF.

    In its own form the user's file is kept but for the corrected numbers. A URDF as MJCF lacks
    shapes; an MJCF as URDF is the bare chain with its masses.

    corrections, markers, target : as for :func:`~calib.files.mjcf_out.corrected_mjcf`

    Raises InputError where the file cannot be read any more, or MuJoCo is needed and missing.
    """
    source = cell.robot_files[0]
    if cell.robot_form == "urdf":
        text = corrected_urdf(source, cell.robot, corrections, markers)
        return text if form == "urdf" else mjcf_of_urdf(source, text, cell.robot.tip)
    if form == "mjcf":
        return corrected_mjcf(source, cell.robot, corrections, markers, target)
    whole = load_robot("mjcf", source, cell.robot.base, cell.robot.tip)  # limits as in the file
    return chain_urdf(whole, corrections, markers)


def not_rigid(model: Model) -> list[str]:
    """Effects ``name:where`` of a model that no rigid robot can hold."""
    rigid = (Constant, Base, Tool)
    return [f"{e.kind}:{e.where}" for e in model.effects if not isinstance(e, rigid)]
