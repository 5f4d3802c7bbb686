"""Samples of hand-eye calibrations: poses of a board in a camera, as easy_handeye and MoveIt keep them.

easy_handeye lists samples of ``robot`` and ``optical`` (or ``tracking``) transforms, its messages
``hand_world_samples`` and ``camera_marker_samples``; MoveIt's calibration lists 4 x 4 matrices by rows,
``effector_wrt_world`` and ``object_wrt_sensor``, and joint states in a file of their own. All lengths
are metres, all quaternions x, y, z, w. The robot's own transforms are left alone: joints tell more.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Literal

import numpy as np

from calib.arm.se3 import inverse, nearest_rotation
from calib.arrays import Array
from calib.errors import InputError
from calib.files.exports.points import (
    PointList,
    body_list,
    is_rotation,
    quaternion_frame,
)
from calib.files.exports.sheet import ExportTable, made_sheet
from calib.files.yaml_text import Node, Scalar, leaves, number_at, read_yaml, scalar_at

YAML = (".yaml", ".yml", ".json")
Eye = Literal["in-hand", "on-base"]
_OPTICAL = ("optical", "tracking", "opt", "object_wrt_sensor")
_LISTED = ("camera_marker_samples", "samples", "transforms")
_EYES: dict[str, Eye] = {
    "eye_in_hand": "in-hand",
    "true": "in-hand",
    "eye_on_base": "on-base",
    "eye_on_hand": "in-hand",
    "false": "on-base",
}
_FARTHEST = 100.0  # m


def read_hand_eye(path: Path, body: str | None, eye: Eye | None) -> PointList:
    """Samples as readings of one body, numbered from 1.

    A camera on the base reads the board as it stands in its own frame; one in the hand is itself the
    body, and what reads it is the board.

    body : its name in the cell; eye : where the camera is, where the file does not tell it

    Raises InputError.
    """
    root: Node = read_yaml(path).root
    told = _told(root)
    if eye is None and told is None:
        what = "does not say where the camera is"
        raise InputError(path, "", what, "give --eye in-hand or --eye on-base")
    if eye is not None and told is not None and eye != told:
        raise InputError(path, "", f"says eye {told}", "leave --eye out")
    if body is None:
        what = "names no body"
        raise InputError(path, "", what, "give --marker NAME, a name of the cell's [bodies]")
    frames = [_frame(path, k, own) for k, own in enumerate(_samples(path, root), 1)]
    where = eye or told
    if where == "in-hand":
        frames = [inverse(T) for T in frames]
    read = [(k, str(k), body, T) for k, T in enumerate(frames, 1)]
    whose = "camera in the board's frame" if where == "in-hand" else "board in the camera's frame"
    columns = ("sample", "position", "quaternion")
    note = f"poses of the {whose}, as the body {body}"
    return body_list(path, read, columns, ("m", "as ROS counts"), note)


def joint_states(path: Path) -> ExportTable:
    """The joint states that MoveIt's calibration saves, numbered as its samples. Raises InputError.

    They carry radians, which MoveIt counts in; joints that slide need another table.
    """
    root = read_yaml(path).root
    names, rows = root.get("joint_names"), root.get("joint_values")
    if not isinstance(names, list) or not isinstance(rows, list) or not names or not rows:
        what = "holds no joint_names and joint_values"
        raise InputError(path, "", what, "give the joint states of MoveIt, or a table")
    titles = [f"{scalar_at(path, own).word}_rad" for own in names]
    values = []
    for k, row in enumerate(rows, 1):
        own = [scalar_at(path, value).word for value in row] if isinstance(row, list) else []
        if len(own) != len(titles):
            what = f"has {len(own)} values of {len(titles)} joints"
            raise InputError(path, f"joint_values, entry {k}", what)
        values.append([str(k), *own])
    return made_sheet(path, [], [["pose", *titles], *values], list(range(len(values) + 1)), ",")


def _told(root: Node) -> Eye | None:
    """Where the camera is, as parameters beside the samples say."""
    if not isinstance(root, dict):
        return None
    own = root.get("parameters", root)
    for key in ("calibration_type", "eye_on_hand"):
        node = own.get(key) if isinstance(own, dict) else None
        if isinstance(node, Scalar):
            return _EYES.get(node.word.lower())
    return None


def _samples(path: Path, root: Node) -> list[Node]:
    """The list of samples, however deep the messages put it."""
    node = root
    while isinstance(node, dict):
        own = node
        key = next((k for k in ("", *_LISTED) if k in own), None)
        if key is None:
            break
        node = own[key]
    if not isinstance(node, list) or not node:
        what = "holds no samples of easy_handeye (robot, optical) or MoveIt (object_wrt_sensor)"
        raise InputError(path, "", what, "is it the file of samples, not of the result?")
    return node


def _frame(path: Path, number: int, sample: Node) -> Array:
    where = f"sample {number}"
    key = next((k for k in _OPTICAL if isinstance(sample, dict) and k in sample), None)
    node = sample[key] if key is not None and isinstance(sample, dict) else sample
    if isinstance(node, list):
        values = [number_at(path, own) for own in leaves(node)]
    else:
        inner = node.get("transform", node) if isinstance(node, dict) else node
        values = []
        for name, keys in (("translation", "xyz"), ("rotation", "xyzw")):
            own = inner.get(name) if isinstance(inner, dict) else None
            if not isinstance(own, dict) or any(axis not in own for axis in keys):
                raise InputError(path, where, f"has no {name} of {', '.join(keys)}")
            values += [number_at(path, own[axis]) for axis in keys]
    if len(values) == 7:  # position and quaternion, else a matrix by rows
        found = quaternion_frame(values[:3], values[3:])
        if found is None:
            what = f"has a quaternion of length {math.hypot(*values[3:]):.4g}"
            raise InputError(path, where, what, "a rotation has a length of one")
        T = found
    else:
        T = np.array(values).reshape(4, 4) if len(values) == 16 else np.full((4, 4), np.nan)
        if not is_rotation(T[:3, :3]) or T[3].tolist() != [0, 0, 0, 1]:
            raise InputError(path, where, "is no transform of 4 x 4 numbers by rows")
        T[:3, :3] = nearest_rotation(T[:3, :3])
    if not np.abs(T[:3, 3]).max() < _FARTHEST:
        raise InputError(path, where, "lies farther than 100 m", "samples count metres")
    return T
