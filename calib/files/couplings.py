"""``[robot.coupled]``: joints without a drive, and what moves them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from calib.arm.mimic import Coupling
from calib.arm.robot import Robot
from calib.errors import InputError
from calib.files.schema import CouplingTable
from calib.files.values import MM


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
