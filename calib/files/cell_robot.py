"""The robot of a cell: that of its file, with what [robot] says of single joints."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from calib.arm.mimic import Coupling
from calib.arm.robot import Robot
from calib.arrays import Array
from calib.errors import InputError
from calib.files.robot import load_robot
from calib.files.schema import CellFile, CouplingTable, RobotTable
from calib.instruments.protocol import TIP
from calib.keys import DEG, MM

_ROUNDED = 1e-9  # rad or m
_OF_JOINTS = {"limits": "", "speed": "_s", "acceleration": "_s2"}
"""What [robot] says of joints by keys with a unit, and what follows ``_deg`` or ``_mm`` in these."""


def robot_of(path: Path, table: CellFile) -> Robot:
    """The robot that a cell names, narrowed, coupled and driven as it says. Raises InputError."""
    own = table.robot
    file = path.parent / own.file
    robot = load_robot(own.form, file, own.base, own.tip, own.dh_convention, table.links)
    _check_joints(path, robot, table)
    robot = coupled(path, robot, own.coupled)
    if table.load is not None:
        robot = replace(robot, loaded=frame_of(robot, table.load.on))
    drives = {}
    for what, given in (("speed", robot.speeds), ("acceleration", robot.accelerations)):
        drives[what] = np.full(robot.dof, math.nan) if given is None else given.copy()
        for _, joint, value in _of_joints(path, robot, own, what):
            drives[what][joint] = value
    robot = _narrowed(path, robot, own)
    return replace(robot, speeds=drives["speed"], accelerations=drives["acceleration"])


def frame_of(robot: Robot, on: str) -> int:
    """Frame of the tip that is named so."""
    return -1 if on == TIP else robot.dof + 1 + robot.tips.index(on)


def _check_joints(path: Path, robot: Robot, table: CellFile) -> None:
    """Refuse keys that name no joint, and knots of a joint that slides."""
    own = table.robot
    named: list[tuple[str, Iterable[str]]] = [
        *(
            (f"robot.{key}", getattr(own, key))
            for what in _OF_JOINTS
            for key in _keys(what).values()
        ),
        ("robot.compensators_mm", own.compensators_mm),
        ("robot.gear_ratio", own.gear_ratio),
        ("robot.coupled", own.coupled),
        ("robot.capsules_mm", {*(own.capsules_mm or ())} - {"base", "tool"}),
        ("design.levels", table.design.levels),
        ("model.knots_deg", table.model.knots_deg),
    ]
    for key, names in named:
        for name in names:
            if name not in robot.joints:
                known = f"joints are {', '.join(robot.joints)}"
                raise InputError(path, f"{key}.{name}", "no such joint", known)
    for joint in table.model.knots_deg:
        if robot.prismatic[robot.joints.index(joint)]:
            raise InputError(path, f"model.knots_deg.{joint}", "is a joint that slides, not turns")


def _keys(what: str) -> dict[bool, str]:
    """Keys for joints that turn, and that slide."""
    return {
        slides: f"{what}_{'mm' if slides else 'deg'}{_OF_JOINTS[what]}" for slides in (False, True)
    }


def _of_joints(
    path: Path, robot: Robot, table: RobotTable, what: str
) -> Iterator[tuple[str, int, Array]]:
    """Key, joint and value, SI, of all that is said of single joints."""
    for slides, key in _keys(what).items():
        for joint, value in getattr(table, key).items():
            index = robot.joints.index(joint)
            if robot.prismatic[index] != slides:
                does = "turns" if slides else "slides"
                fault = f"joint {joint} {does}: this is in another unit"
                remedy = f"write it under [robot.{_keys(what)[not slides]}]"
                raise InputError(path, f"robot.{key}.{joint}", fault, remedy)
            yield f"robot.{key}.{joint}", index, np.array(value) * (MM if slides else DEG)


def _narrowed(path: Path, robot: Robot, table: RobotTable) -> Robot:
    """The robot within the limits of the cell, too. Raises InputError where these leave nothing."""
    limits = robot.limits.copy()
    for key, joint, (low, high) in _of_joints(path, robot, table, "limits"):
        limits[joint] = max(limits[joint, 0], low), min(limits[joint, 1], high)
        if limits[joint, 0] > limits[joint, 1]:
            what = f"leaves nothing of the {table.form.upper()}'s limits"
            unit = MM if robot.prismatic[joint] else DEG
            known = "those are {:g} .. {:g}".format(*(robot.limits[joint] / unit))
            raise InputError(path, key, what, known)
    narrowed = replace(robot, limits=limits)
    for name, (low, high) in zip(robot.joints, narrowed.sample_limits(), strict=True):
        if low > high + _ROUNDED:
            what = f"limits leave nothing to {name}, which moves with others"
            raise InputError(path, "robot", what, "widen those in the cell or robot's file")
    return narrowed


def coupled(path: Path, robot: Robot, table: Mapping[str, CouplingTable]) -> Robot:
    """The robot with its joints coupled as a cell says.

    Raises InputError for a joint that follows another already, for what moves itself, also by way of
    others, and for an offset in another unit.
    """
    following = {mimic.joint: (mimic.master,) for mimic in robot.mimics}
    couplings = []
    for joint, own in table.items():
        where = f"robot.coupled.{joint}"
        if joint in following:
            what = f"the robot's file has it mimic {following[joint][0]}"
            raise InputError(path, where, what, "take one of them out")
        for other, factor in own.of.items():
            if other not in robot.joints or not factor:
                what = f"'of' names {other!r} with {factor:g}, which moves nothing"
                known = f"name joints that move it: {', '.join(robot.joints)}"
                raise InputError(path, where, what, known)
        slides = bool(robot.prismatic[robot.joints.index(joint)])
        if own.offset_deg if slides else own.offset_mm:
            key, does = ("offset_mm", "slides") if slides else ("offset_deg", "turns")
            raise InputError(path, where, f"the joint {does}", f"give {key}")
        offset = own.offset_mm * MM if slides else math.radians(own.offset_deg)
        couplings.append(Coupling(joint, tuple(own.of.items()), offset))
    followed = following | {joint: tuple(own.of) for joint, own in table.items()}
    for joint in table:
        if joint in _masters(followed, joint):
            what = "moves itself, by way of what moves it"
            raise InputError(path, f"robot.coupled.{joint}", what, "let one of these move freely")
    return replace(robot, couplings=tuple(couplings)) if couplings else robot


def _masters(followed: Mapping[str, tuple[str, ...]], joint: str) -> set[str]:
    """All that moves a joint, those that move others among them."""
    found: list[str] = [*followed[joint]]
    for name in found:  # grows
        found += [other for other in followed.get(name, ()) if other not in found]
    return set(found)
