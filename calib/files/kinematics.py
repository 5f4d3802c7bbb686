"""Kinematics files of robot makers, in and out: six numbers a joint, as in the origin of a URDF.

Universal Robots (ROS ``default_kinematics.yaml``, one of each arm from its own calibration) and Franka
(``kinematics.yaml``). They hold neither limits nor masses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.arm.robot import Robot
from calib.arm.se3 import displacement, from_xyz_rpy, inverse, rpy_from_rotation
from calib.arrays import Array
from calib.errors import InputError
from calib.files.yaml_text import Node, Scalar, YamlText, read_yaml, rewritten

UR_JOINTS = (
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
)
_UR_KEYS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
_FRANKA_JOINTS = tuple(f"joint{k}" for k in range(1, 8))
_KEYS = ("x", "y", "z", "roll", "pitch", "yaw")
_LARGEST = 1e3  # m or rad


@dataclass(frozen=True)
class Maker:
    """How a maker's file names joints and frames.

    keys : of the joints in the file; Franka's last one is the fixed flange
    bases : names of the first frame, each with whether it is ``base_link``, which is turned by pi about
        z against the frame in which the first joint is given; the first one is the default
    """

    name: str
    joints: tuple[str, ...]
    keys: tuple[str, ...]
    bases: dict[str, bool]
    tip: str


UR = Maker(
    "Universal Robots",
    UR_JOINTS,
    _UR_KEYS,
    {"base_link": True, "base_link_inertia": False, "base": False},
    "tool0",
)
FRANKA = Maker("Franka", _FRANKA_JOINTS, (*_FRANKA_JOINTS, "joint8"), {"link0": False}, "link8")


def maker_of(path: Path, file: YamlText) -> Maker:
    """Whose file it is. Raises InputError."""
    if "kinematics" in file.root:
        return UR
    if "joint1" in file.root:
        return FRANKA
    raise InputError(
        path,
        "",
        "is no kinematics file of Universal Robots (kinematics: shoulder: ..) or Franka (joint1: ..)",
        "is it the right file?",
    )


def load_kinematics(path: Path, base: str, tip: str) -> Robot:
    """The chain of a kinematics file, without limits and masses. Raises InputError.

    base, tip : names of the ends; empty for the maker's own
    """
    file = read_yaml(path)
    maker = maker_of(path, file)
    turned = _turned(path, maker, base)
    origins = [_origin(path, scalars) for scalars in _scalars(path, file, maker)]
    origins[0] = (_HALF_TURN if turned else np.eye(4)) @ origins[0]
    n = len(maker.joints)
    return Robot(
        name=path.stem,
        base=base or next(iter(maker.bases)),
        tip=tip or maker.tip,
        joints=maker.joints,
        prismatic=np.zeros(n, dtype=bool),
        origins=np.array([*origins, np.eye(4)][: n + 1]),
        axes=np.tile([0.0, 0.0, 1.0], (n, 1)),
        limits=np.tile([-np.inf, np.inf], (n, 1)),
        efforts=np.full(n, np.nan),
        masses=np.zeros(n),
        coms=np.zeros((n, 3)),
    )


def corrected_kinematics(source: Path, corrections: Array) -> str:
    """The user's own file with the identified geometry; comments and the hash stay.

    corrections : ndarray, shape (n + 2, 6), m and rad; Franka's flange takes that of the tip, in a file
        of Universal Robots the tip has no place

    Raises InputError.
    """
    file = read_yaml(source)
    maker = maker_of(source, file)
    values: dict[Scalar, str] = {}
    for scalars, xi in zip(_scalars(source, file, maker), corrections[1:], strict=False):
        if xi.any():
            texts = _texts(_origin(source, scalars) @ displacement(xi))
            values |= dict(zip(scalars.values(), texts, strict=True))
    return rewritten(file.text, values)


def kinematics_of(robot: Robot, corrections: Array) -> str:
    """The text of a kinematics file of an arm that was read from another form.

    Raises InputError for an arm that is by its joints' names neither a UR nor a Franka, or whose joints
    do not turn about z.
    """
    maker = _maker_of_joints(robot)
    origins = robot.origins @ displacement(corrections[1:])
    if maker is UR and robot.base not in ("base_link_inertia", "base"):
        origins[0] = inverse(_HALF_TURN) @ origins[0]
    lines = ["kinematics:"] if maker is UR else []
    for key, T in zip(maker.keys, origins, strict=False):
        indent = "  " if maker is UR else ""
        lines += [f"{indent}{key}:"] + ([] if maker is UR else ["  kinematic:"])
        lines += [f"    {name}: {text}" for name, text in zip(_KEYS, _texts(T), strict=True)]
    return "\n".join([*lines, ""])


def kinematics_lacks(robot: Robot, corrections: Array, own: bool) -> list[str]:
    """What a kinematics file does not hold of a corrected arm; ``own`` where the user has one."""
    lacks = []
    maker = _maker_of_joints(robot)
    if maker is UR and corrections[robot.tip_frame].any():
        lacks.append(f"has no place for {robot.tip}: its displacement is left out")
    if maker is UR and not own:
        lacks.append(
            "has no hash: the driver wants that of this very arm, copy it from its own file"
        )
    return lacks


def _maker_of_joints(robot: Robot) -> Maker:
    straight = not robot.prismatic.any() and np.abs(robot.axes - [0.0, 0.0, 1.0]).max() < 1e-12
    for maker in (UR, FRANKA):
        pairs = zip(robot.joints, maker.joints, strict=False)
        if len(robot.joints) == len(maker.joints) and all(j.endswith(k) for j, k in pairs):
            if straight:
                return maker
            raise InputError(
                "--kinematics", "", f"the axes of this {maker.name} are not all +z in their frames",
                "take the maker's own URDF",
            )  # fmt: skip
    raise InputError(
        "--kinematics",
        f"joints {', '.join(robot.joints)}",
        "are neither those of Universal Robots (shoulder_pan_joint ..) nor of Franka (joint1 ..)",
        "write a URDF (--urdf) or a DH table (--dh)",
    )


_HALF_TURN = np.diag([-1.0, -1.0, 1.0, 1.0])


def _turned(path: Path, maker: Maker, base: str) -> bool:
    if maker is FRANKA or not base:
        return next(iter(maker.bases.values()))
    if base not in maker.bases:
        known = ", ".join(maker.bases)
        raise InputError(path, "", f"has no frame {base!r}", f"set [robot] base to one of: {known}")
    return maker.bases[base]


def _scalars(path: Path, file: YamlText, maker: Maker) -> list[dict[str, Scalar]]:
    """x .. yaw of every joint. Raises InputError where one is missing."""
    found = []
    above = file.root["kinematics"] if maker is UR else file.root
    for key in maker.keys:
        own = _below(path, above, key, "")
        if maker is FRANKA:
            own = _below(path, own, "kinematic", key)
        scalars = {}
        for name in _KEYS:
            value = _below(path, own, name, key)
            if not isinstance(value, Scalar):
                raise InputError(path, key, f"{name} is no number")
            scalars[name] = value
        found.append(scalars)
    return found


def _below(path: Path, node: Node, key: str, where: str) -> Node:
    if not isinstance(node, dict) or key not in node:
        raise InputError(
            path, where, f"{key!r} is missing", "complete it from the maker's own file"
        )
    return node[key]


def _origin(path: Path, scalars: dict[str, Scalar]) -> Array:
    values = np.array([_number(path, scalars[name]) for name in _KEYS])
    return from_xyz_rpy(values[:3], values[3:])


def _number(path: Path, scalar: Scalar) -> float:
    try:
        value = float(scalar.word)
    except ValueError:
        value = math.nan
    if not abs(value) < _LARGEST:
        raise InputError(
            path,
            f"line {scalar.line}",
            f"{scalar.word[:40]!r} is not a number in m or rad",
            "evaluate expressions first",
        )
    return value


def _texts(T: Array) -> list[str]:
    return [f"{v + 0.0:.17g}" for v in (*T[:3, 3], *rpy_from_rotation(T[:3, :3]))]
