"""Read the nominal robot: one reader a format, by its key in the [robot] table."""

from __future__ import annotations

from pathlib import Path

from calib.arm.dh import Convention
from calib.arm.robot import Robot
from calib.cell import Form
from calib.files.dh import load_dh
from calib.files.kinematics import load_kinematics
from calib.files.mjcf import load_mjcf, mjcf_files
from calib.files.urdf import load_urdf

READERS = {"urdf": load_urdf, "mjcf": load_mjcf, "kinematics": load_kinematics}


def load_robot(
    form: Form, path: Path, base: str, tip: str, convention: Convention | None = None
) -> Robot:
    """The chain from ``base`` to ``tip`` of a file.

    convention : of a DH table, whose ends have no names but these words

    Raises InputError.
    """
    if convention is not None:
        return load_dh(path, convention, base or "base", tip or "tip")
    return READERS[form](path, base, tip)


def robot_files(form: Form, path: Path) -> tuple[Path, ...]:
    """The file and all that it includes, which only an MJCF does. Raises InputError."""
    return mjcf_files(path) if form == "mjcf" else (path,)
