"""A chain as a URDF of its own: joints, limits and masses, no shapes and no moments of inertia."""

from __future__ import annotations

from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from calib.arm.robot import Robot
from calib.arm.se3 import displacement, transform
from calib.arrays import Array
from calib.files.urdf_out import words, write_markers, write_origin

_WIDE = 1e3  # m
_NO_INERTIA = {f"i{axes}": "0" for axes in ("xx", "xy", "xz", "yy", "yz", "zz")}


def chain_urdf(robot: Robot, corrections: Array, markers: dict[str, Array]) -> str:
    """The text of a URDF of a robot with the identified geometry.

    The link that joint A moves is named ``A_link``; an effort that is not given is 0.

    corrections, markers : as for :func:`~calib.files.urdf_out.corrected_urdf`
    """
    root = Element("robot", name=robot.name)
    origins = robot.origins @ displacement(corrections[1:])
    link = robot.base
    SubElement(root, "link", name=link)
    for k, name in enumerate(robot.joints):
        joint = _joint(root, name, link, _free_name(robot, f"{name}_link"), origins[k])
        link = _free_name(robot, f"{name}_link")
        SubElement(joint, "axis", xyz=words(robot.axes[k]))
        _limit(joint, robot, k)
        _inertial(root[-1], robot, k)
    _joint(root, _free_name(robot, "tip_mount"), link, robot.tip, origins[-1]).set("type", "fixed")
    write_markers(root, robot.tip, np.eye(4), markers)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _free_name(robot: Robot, name: str) -> str:
    """A name that neither the ends nor the joints of the chain bear."""
    while name in (robot.base, robot.tip, *robot.joints):
        name += "_"
    return name


def _joint(root: Element, name: str, parent: str, child: str, origin: Array) -> Element:
    """A joint and, after it, the link that it moves."""
    joint = SubElement(root, "joint", name=name)
    write_origin(joint, origin)
    SubElement(joint, "parent", link=parent)
    SubElement(joint, "child", link=child)
    SubElement(root, "link", name=child)
    return joint


def _limit(joint: Element, robot: Robot, k: int) -> None:
    """Type and limits; a joint that slides needs limits in a URDF, and has wide ones without."""
    limited = bool(np.isfinite(robot.limits[k]).all())
    joint.set(
        "type", "prismatic" if robot.prismatic[k] else "revolute" if limited else "continuous"
    )
    limit = SubElement(
        joint, "limit", effort=f"{np.nan_to_num(robot.efforts[k]):.15g}", velocity="0"
    )
    if limited or robot.prismatic[k]:
        low, high = np.clip(robot.limits[k], -_WIDE, _WIDE)
        limit.set("lower", f"{low:.15g}")
        limit.set("upper", f"{high:.15g}")


def _inertial(link: Element, robot: Robot, k: int) -> None:
    if robot.masses[k] > 0:
        inertial = SubElement(link, "inertial")
        write_origin(inertial, transform(np.eye(3), robot.coms[k]))
        SubElement(inertial, "mass", value=f"{robot.masses[k]:.15g}")
        SubElement(inertial, "inertia", _NO_INERTIA)
