"""Read the nominal robot: one reader a format, by its key in the [robot] table."""

from __future__ import annotations

from pathlib import Path

from calib.arm.robot import Robot
from calib.files.mjcf import load_mjcf, mjcf_files
from calib.files.urdf import load_urdf

READERS = {"urdf": load_urdf, "mjcf": load_mjcf}


def load_robot(form: str, path: Path, base: str, tip: str) -> Robot:
    """The chain from ``base`` to ``tip`` of a file in the form ``urdf`` or ``mjcf``.

    Raises InputError.
    """
    return READERS[form](path, base, tip)


def robot_files(form: str, path: Path) -> tuple[Path, ...]:
    """The file and all that it includes: a URDF includes nothing. Raises InputError."""
    return mjcf_files(path) if form == "mjcf" else (path,)
