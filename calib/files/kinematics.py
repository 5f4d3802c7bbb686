"""Kinematics files of robot makers, in and out: six numbers a joint, as in the origin of a URDF.

Universal Robots (ROS ``default_kinematics.yaml``, one of each arm from its own calibration) and Franka
(``kinematics.yaml``). They hold neither limits nor masses. The ``calibration.conf`` of a controller of
Universal Robots is read too: it holds differences to a classic DH table. Between the parallel axes 2, 3
and 4 they follow the common normals, which lie where they please: d of hundreds of metres that cancel.
The arm is the same with d where the nominal table has it, and Hayati's beta for the tilt.
"""

from __future__ import annotations

import configparser
import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib.arm.dh import DhTable, dh_of_robot, robot_of_dh
from calib.arm.robot import Robot
from calib.arm.se3 import displacement, from_xyz_rpy, inverse, rpy_from_rotation
from calib.arrays import Array
from calib.errors import InputError
from calib.files.read import read_text
from calib.files.yaml_text import Node, Scalar, YamlText, number_at, read_yaml, rewritten

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
    makers = "Universal Robots (kinematics: shoulder: ..) or Franka (joint1: ..)"
    raise InputError(path, "", f"is no kinematics file of {makers}", "is it the right file?")


def load_kinematics(path: Path, base: str, tip: str) -> Robot:
    """The chain of a kinematics file, without limits and masses. Raises InputError.

    base, tip : names of the ends; empty for the maker's own
    """
    file = read_yaml(path)
    maker = maker_of(path, file)
    base = base or next(iter(maker.bases))
    if maker is UR and base not in maker.bases:
        remedy = f"set [robot] base to one of: {', '.join(maker.bases)}"
        raise InputError(path, "", f"has no frame {base!r}", remedy)
    turned = maker.bases.get(base, False)
    origins = [_origin(path, scalars) for scalars in _scalars(path, file, maker)]
    origins[0] = (_HALF_TURN if turned else np.eye(4)) @ origins[0]
    n = len(maker.joints)
    ends, turning = (base, tip or maker.tip), np.zeros(n, dtype=bool)
    whole = np.array([*origins, np.eye(4)][: n + 1])
    return Robot.of_geometry(path.stem, ends, maker.joints, turning, whole)


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
        lines += [f"  {key}:"] if maker is UR else [f"{key}:", "  kinematic:"]
        lines += [f"    {name}: {text}" for name, text in zip(_KEYS, _texts(T), strict=True)]
    return "\n".join([*lines, ""])


def kinematics_lacks(robot: Robot, corrections: Array, own: bool) -> list[str]:
    """What a kinematics file does not hold of a corrected arm; ``own`` where the user has one."""
    lacks = []
    maker = _maker_of_joints(robot)
    if maker is UR and corrections[robot.tip_frame].any():
        lacks.append(f"has no place for {robot.tip}: its displacement is left out")
    if maker is UR and not own:
        remedy = "the driver wants that of this very arm, copy it from its own file"
        lacks.append(f"has no hash: {remedy}")
    return lacks


def _maker_of_joints(robot: Robot) -> Maker:
    straight = not robot.prismatic.any() and np.abs(robot.axes - [0.0, 0.0, 1.0]).max() < 1e-12
    for maker in (UR, FRANKA):
        pairs = zip(robot.joints, maker.joints, strict=False)
        if len(robot.joints) == len(maker.joints) and all(j.endswith(k) for j, k in pairs):
            if straight:
                return maker
            what = f"the axes of this {maker.name} are not all +z in their frames"
            raise InputError("--kinematics", "", what, "take the maker's own URDF")
    joints, remedy = ", ".join(robot.joints), "write a URDF (--urdf) or a DH table (--dh)"
    what = "are neither those of Universal Robots (shoulder_pan_joint ..) nor of Franka (joint1 ..)"
    raise InputError("--kinematics", f"joints {joints}", what, remedy)


_HALF_TURN = np.diag([-1.0, -1.0, 1.0, 1.0])


def _scalars(path: Path, file: YamlText, maker: Maker) -> list[dict[str, Scalar]]:
    """x .. yaw of every joint. Raises InputError where one is missing."""
    found = []
    for key in maker.keys:
        own: Node = file.root
        places = (("kinematics", ""), (key, "")) if maker is UR else ((key, ""), ("kinematic", key))
        for name, where in places:
            own = _below(path, own, name, where)
        scalars = {name: _below(path, own, name, key) for name in _KEYS}
        for name, value in scalars.items():
            if not isinstance(value, Scalar):
                raise InputError(path, key, f"{name} is no number")
        found.append({n: value for n, value in scalars.items() if isinstance(value, Scalar)})
    return found


def _below(path: Path, node: Node, key: str, where: str) -> Node:
    if not isinstance(node, dict) or key not in node:
        remedy = "complete it from the maker's own file"
        raise InputError(path, where, f"{key!r} is missing", remedy)
    return node[key]


def _origin(path: Path, scalars: dict[str, Scalar]) -> Array:
    what, remedy = "is not a number in m or rad", "evaluate expressions first"
    numbers = [number_at(path, scalars[name], _LARGEST, what, remedy) for name in _KEYS]
    values = np.array(numbers)
    return from_xyz_rpy(values[:3], values[3:])


def _texts(T: Array) -> list[str]:
    return [f"{v + 0.0:.17g}" for v in (*T[:3, 3], *rpy_from_rotation(T[:3, :3]))]


_LARGEST_FILE = 1_000_000  # bytes
_FARTHEST = 1e5  # m or rad
_SECTION = "mounting"
_ALPHA = (np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0)

MODELS: dict[str, tuple[tuple[float, float], tuple[float, float, float, float]]] = {
    "UR3": ((-0.24365, -0.21325), (0.1519, 0.11235, 0.08535, 0.0819)),
    "UR5": ((-0.425, -0.39225), (0.089159, 0.10915, 0.09465, 0.0823)),
    "UR10": ((-0.612, -0.5723), (0.1273, 0.163941, 0.1157, 0.0922)),
    "UR3e": ((-0.24355, -0.2132), (0.15185, 0.13105, 0.08535, 0.0921)),
    "UR5e": ((-0.425, -0.3922), (0.1625, 0.1333, 0.0997, 0.0996)),
    "UR10e": ((-0.6127, -0.57155), (0.1807, 0.17415, 0.11985, 0.11655)),
    "UR16e": ((-0.4784, -0.36), (0.1807, 0.17415, 0.11985, 0.11655)),
    "UR20": ((-0.862, -0.7287), (0.2363, 0.201, 0.1593, 0.1543)),
    "UR30": ((-0.637, -0.5037), (0.2363, 0.201, 0.1593, 0.1543)),
}
"""(a of rows 2 and 3, d of rows 1, 4, 5 and 6) [m] as the maker publishes them; all others are 0."""


def nominal_ur(model: str) -> DhTable:
    """The classic table of a model. Raises InputError for one that is not known."""
    known = {name.lower(): name for name in MODELS}
    if model.lower() not in known:
        raise InputError("--model", "", f"{model!r} is not known", f"use {', '.join(MODELS)}")
    (a2, a3), (d1, d4, d5, d6) = MODELS[known[model.lower()]]
    return DhTable(
        convention="classic",
        joints=UR_JOINTS,
        prismatic=np.zeros(6, dtype=bool),
        alpha=np.array(_ALPHA),
        a=np.array([0.0, a2, a3, 0.0, 0.0, 0.0]),
        theta=np.zeros(6),
        d=np.array([d1, 0.0, 0.0, d4, d5, d6]),
        beta=np.zeros(6),
    )


def read_ur_calibration(path: Path, model: str) -> DhTable:
    """The calibrated table of an arm, its numbers near the nominal ones. Raises InputError."""
    nominal = nominal_ur(model)
    deltas = _deltas(path)
    exact = replace(nominal, **{k: getattr(nominal, k) + own for k, own in deltas.items()})
    robot = robot_of_dh(exact, model, "base", "tool0")
    return dh_of_robot(robot, np.zeros((robot.dof + 2, 6)), nominal).table


def _deltas(path: Path) -> dict[str, Array]:
    parser = configparser.RawConfigParser(strict=False)
    try:
        parser.read_string(read_text(path, _LARGEST_FILE))
    except configparser.Error:
        parser.clear()
    if not parser.has_section(_SECTION):
        remedy = "is it the calibration.conf of a UR controller?"
        raise InputError(path, "", f"has no [{_SECTION}]", remedy)
    found = {}
    for name in ("theta", "a", "d", "alpha"):
        key = f"delta_{name}"
        text = parser.get(_SECTION, key, fallback="")
        try:
            values = np.array(json.loads(text.split("#")[0]), dtype=float)
        except (ValueError, TypeError, RecursionError):
            values = np.array([])
        if values.shape != (6,) or not (np.abs(values) < _FARTHEST).all():
            what = f"is missing in [{_SECTION}]" if not text else "is no list of six numbers"
            raise InputError(path, key, what, "copy the file from the controller again")
        found[name] = values
    return found
