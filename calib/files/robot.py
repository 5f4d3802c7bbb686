"""The nominal robot from any form: URDF, MJCF, DH table."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from calib.arm.robot import Convention, Form, Robot
from calib.errors import InputError
from calib.files.dh import load_dh
from calib.files.mjcf import load_mjcf
from calib.files.urdf import load_urdf

_FARTHEST = 50.0  # m: no link is as long


def load_robot(
    form: Form,
    path: Path,
    base: str,
    tip: str,
    convention: Convention | None = None,
    others: tuple[str, ...] = (),
) -> Robot:
    """The arm from ``base`` to ``tip`` of a file, with its shapes; a DH table has none.

    convention : of a DH table, whose ends have no names but these words
    others : links that are tips as well, of a URDF or MJCF

    Raises InputError.
    """
    if convention is not None and others:
        what, remedy = f"has one tip, and {others[0]!r} is another", "write the robot as a URDF"
        raise InputError(path, "", what, f"{remedy} or MJCF to have things on several links")
    if convention is not None:
        robot = load_dh(path, convention, base or "base", tip or "tip")
    else:
        robot = (load_mjcf if form == "mjcf" else load_urdf)(path, base, tip, others)
    lengths = np.linalg.norm(robot.origins[:, :3, 3], axis=1)
    for name, length in zip((*robot.joints, *robot.tips), lengths, strict=True):
        if length > _FARTHEST:
            what = f"is {length:.4g} m from the frame before"
            remedy = f"the file counts metres: if these are millimetres, write {length / 1e3:.4g}"
            raise InputError(path, f"origin of {name}", what, remedy)
    return robot
