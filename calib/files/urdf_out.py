"""Write a URDF with the identified geometry: the user's own file, its joint origins corrected."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from calib.arm.robot import Robot
from calib.arm.se3 import displacement, rotate, rpy_from_rotation
from calib.arrays import Array
from calib.files.urdf import MOVING, UrdfJoint, chain_of, origin_of, parse

MARKER = "marker_"  # how links and sites of markers begin


def corrected_urdf(
    source: str | Path, robot: Robot, corrections: Array, markers: dict[str, Array]
) -> str:
    """The text of a URDF whose joint origins carry the identified geometry.

    source : path of the nominal URDF
    corrections : ndarray, shape (n + 2, 6), m and rad, displacement of each frame as in
        :class:`~calib.arm.robot.Robot`; that of the base is not part of the robot and is ignored
    markers : dict, name -> ndarray, shape (3,), m, tip frame: written as links ``marker_<name>``

    The tip's displacement goes into the last fixed joint, or into the markers where there is none.
    """
    path = Path(source)
    root = parse(path)
    chain = chain_of(path, root, robot.base, robot.tip)
    frame, D_tip = 0, displacement(corrections[robot.tip_frame])
    for joint in chain:
        if joint.kind in MOVING:
            frame += 1
            _displace(path, joint, displacement(corrections[frame]))
    if chain[-1].kind == "fixed":
        _displace(path, chain[-1], D_tip)
        D_tip = np.eye(4)
    write_markers(root, robot.tip, D_tip, markers)
    ElementTree.indent(root)
    text: str = ElementTree.tostring(root, encoding="unicode", xml_declaration=True)
    return text + "\n"


def write_markers(root: ElementTree.Element, tip: str, T: Array, markers: dict[str, Array]) -> None:
    """Links ``marker_<name>`` at points given behind the transform T of the tip."""
    for element in [e for e in root if e.get("name", "").startswith(MARKER)]:
        root.remove(element)  # of an earlier correction
    for name, position in markers.items():
        ElementTree.SubElement(root, "link", name=MARKER + name)
        joint = ElementTree.SubElement(root, "joint", name=f"{MARKER}{name}_mount", type="fixed")
        place = T.copy()
        place[:3, 3] += rotate(T[:3, :3], position)
        write_origin(joint, place)
        ElementTree.SubElement(joint, "parent", link=tip)
        ElementTree.SubElement(joint, "child", link=MARKER + name)


def _displace(path: Path, joint: UrdfJoint, D: Array) -> None:
    write_origin(joint.element, origin_of(path, f"joint {joint.name}", joint.element) @ D)


def write_origin(element: ElementTree.Element, T: Array) -> None:
    """Set the <origin> of a joint or an inertial to a transform of shape (4, 4)."""
    origin = element.find("origin")
    if origin is None:
        origin = ElementTree.SubElement(element, "origin")
    origin.set("xyz", words(T[:3, 3]))
    origin.set("rpy", words(rpy_from_rotation(T[:3, :3])))


def words(values: Array) -> str:
    """Numbers to 15 digits, as URDF attributes hold them."""
    return " ".join(f"{value + 0.0:.15g}" for value in values)  # no -0
