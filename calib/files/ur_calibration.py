"""The ``calibration.conf`` of a controller of Universal Robots: differences to a classic DH table.

Between the parallel axes 2, 3 and 4 they follow the common normals, which lie where they please: d of
hundreds of metres that cancel. The arm is the same with d where the nominal table has it, and Hayati's
beta for the tilt.
"""

from __future__ import annotations

import configparser
import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from calib.arm.dh import DhTable, dh_of_robot, robot_of_dh
from calib.arrays import Array
from calib.errors import InputError
from calib.files.read import read_text

UR_JOINTS = (
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
)
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
    return dh_of_robot(robot, nominal)


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
