"""Write the corrected robot in either form, from either form."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Literal

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

if TYPE_CHECKING:
    from calib.identification import Identification

Form = Literal["urdf", "mjcf"]

_LACKS = {
    ("urdf", "mjcf"): "without shapes",
    ("mjcf", "urdf"): "the bare chain, without shapes and moments of inertia",
}
"""What a robot has not in the second form that it may have in the first."""


def corrected_robots(
    cell: Cell, found: Identification, paths: Mapping[Form, Path | None]
) -> dict[Path, str]:
    """The text of each robot to write, by its path. Raises InputError as :func:`corrected_robot`."""
    corrections = found.model.constant_displacements(found.values)
    markers = dict(zip(found.model.marker_names, found.marker_positions, strict=True))
    return {
        path: corrected_robot(cell, form, corrections, markers, path)
        for form, path in paths.items()
        if path is not None
    }


def left_out(cell: Cell, model: Model, paths: Mapping[Form, Path | None]) -> list[str]:
    """What the robots that are written do not hold, in sentences."""
    written = {form: path for form, path in paths.items() if path is not None}
    said = [
        f"{path} is made anew from the {cell.robot_form.upper()}: {_LACKS[cell.robot_form, form]}"
        for form, path in written.items()
        if form != cell.robot_form
    ]
    rigid = (Constant, Base, Tool)
    names = [f"{e.kind}:{e.where}" for e in model.effects if not isinstance(e, rigid)]
    if written and names:
        said.append(f"the robot written is rigid, without {', '.join(names)}")
    return said


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
