"""Exports of instruments and controllers, read and joined into one table of measurements."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from calib.errors import InputError
from calib.files.exports.hand_eye import YAML, Eye, read_hand_eye
from calib.files.exports.join import Joined
from calib.files.exports.joints import JointTable, read_joints
from calib.files.exports.motion_capture import is_motion_capture, read_motion_capture
from calib.files.exports.points import PointList, read_points
from calib.files.exports.sightings import IMAGES

__all__ = ["Eye", "Joined", "JointTable", "PointList", "read_export", "read_joints", "read_points"]


def read_export(
    path: Path,
    unit: str | None = None,
    columns: Sequence[str] | None = None,
    body: str | None = None,
    eye: Eye | None = None,
    alone: str | None = None,
) -> PointList:
    """Read what an instrument exports: points, bodies of motion capture, samples of a hand-eye program.

    unit, columns : of points, as in :func:`read_points`
    body : the cell's name of the file's only body; alone : of the only one that the cell has
    eye : where the camera of a hand-eye calibration is

    Raises InputError.
    """
    if path.suffix.lower() in IMAGES:
        raise InputError(path, "", "is an image", "say what it shows: --board NAME, of the cell")
    samples = path.suffix.lower() in YAML
    if eye is not None and not samples:
        raise InputError("--eye", "", f"{path} holds no samples of a camera", "leave it out")
    if not samples and not is_motion_capture(path):
        return read_points(path, unit, columns)
    found = read_hand_eye(path, body or alone, eye) if samples else read_motion_capture(path, body)
    if columns is not None or unit not in (None, found.unit):
        option = "--unit" if columns is None else "--columns"
        raise InputError(option, "", f"{path} says that itself", "leave it out")
    return found
