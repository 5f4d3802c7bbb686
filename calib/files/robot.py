"""Read the nominal robot: one reader a format, by its key in the [robot] table."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from calib.arm.dh import Convention
from calib.arm.robot import Robot
from calib.cell import Form, Shapes
from calib.errors import InputError
from calib.files.collision import urdf_shapes
from calib.files.dh import load_dh
from calib.files.kinematics import load_kinematics
from calib.files.mjcf import load_mjcf, mjcf_files
from calib.files.mjcf_collision import mjcf_shapes
from calib.files.urdf import load_urdf

_FARTHEST = 50.0  # m: no link is as long
READERS = {"urdf": load_urdf, "mjcf": load_mjcf, "kinematics": load_kinematics}


def load_robot(
    form: Form, path: Path, base: str, tip: str, convention: Convention | None = None
) -> Robot:
    """The chain from ``base`` to ``tip`` of a file.

    convention : of a DH table, whose ends have no names but these words

    Raises InputError.
    """
    if convention is not None:
        robot = load_dh(path, convention, base or "base", tip or "tip")
    else:
        robot = READERS[form](path, base, tip)
    _refuse_far_origins(path, robot)
    return robot


def shapes_of(form: Form, path: Path, robot: Robot) -> Shapes:
    """What the robot's file says of its shape; a DH table says nothing."""
    read = {"urdf": urdf_shapes, "mjcf": mjcf_shapes}.get(form)
    return Shapes({}) if read is None else read(path, robot.base, robot.tip)


def _refuse_far_origins(path: Path, robot: Robot) -> None:
    """A link of a hundred metres is one of millimetres."""
    lengths = np.linalg.norm(robot.origins[:, :3, 3], axis=1)
    for name, length in zip((*robot.joints, robot.tip), lengths, strict=True):
        if length > _FARTHEST:
            raise InputError(
                path,
                f"origin of {name}",
                f"is {length:.4g} m from the frame before",
                f"the file counts metres: if these are millimetres, write {length / 1e3:.4g}",
            )


def robot_files(form: Form, path: Path) -> tuple[Path, ...]:
    """The file and all that it includes, which only an MJCF does. Raises InputError."""
    return mjcf_files(path) if form == "mjcf" else (path,)
