"""Read the nominal robot: one reader a format, by its key in the [robot] table."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from calib.arm.robot import Robot
from calib.errors import InputError
from calib.files.mjcf import load_mjcf, mjcf_files
from calib.files.urdf import load_urdf

_FARTHEST = 50.0  # m: no link is as long
READERS = {"urdf": load_urdf, "mjcf": load_mjcf}


def load_robot(form: str, path: Path, base: str, tip: str) -> Robot:
    """The chain from ``base`` to ``tip`` of a file in the form ``urdf`` or ``mjcf``.

    Raises InputError.
    """
    robot = READERS[form](path, base, tip)
    _refuse_far_origins(path, robot)
    return robot


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


def robot_files(form: str, path: Path) -> tuple[Path, ...]:
    """The file and all that it includes: a URDF includes nothing. Raises InputError."""
    return mjcf_files(path) if form == "mjcf" else (path,)
