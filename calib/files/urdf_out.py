"""Write a URDF with the identified geometry: the user's own file, or a chain from another form."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from calib.arm.robot import Robot
from calib.arm.se3 import displacement, rpy_from_rotation, transform, transformed
from calib.arrays import Array
from calib.files.urdf import Urdf

MARKER = "marker_"  # how links and sites of markers begin


def corrected_urdf(
    source: str | Path,
    robot: Robot,
    corrections: Array,
    markers: dict[str, Array],
    links: Mapping[str, str] | None = None,
) -> str:
    """The text of a URDF whose joint origins carry the identified geometry.

    source : path of the nominal URDF
    corrections : ndarray, shape (F, 6), m and rad, displacement of each frame as in
        :class:`~calib.arm.robot.Robot`; that of the base is not part of the robot and is ignored
    markers : dict, name -> ndarray, shape (3,), m, tip frame: written as links ``marker_<name>``
    links : dict, name -> the tip on which a marker rides; all on ``robot.tip`` without

    A tip's displacement goes into the fixed joint that carries it alone, or into the markers on it
    where there is none.
    """
    urdf = Urdf.read(Path(source))
    chain = urdf.chain(robot.base, robot.tip, robot.others)
    moved = displacement(corrections[1:])
    before, n = {joint.child: joint for joint in chain}, robot.dof
    passed = {robot.base, *(joint.parent for joint in chain)}
    written = dict(zip((joint for joint in chain if joint.moves), moved[:n], strict=True))
    placed = dict(zip(robot.tips, moved[n:], strict=True))
    for tip, D in placed.items():
        if tip not in passed and not before[tip].moves:
            written[before[tip]], placed[tip] = D, np.eye(4)
    for joint, D in written.items():
        _write_origin(joint.element, urdf.origin_of(joint) @ D)
    on = links or dict.fromkeys(markers, robot.tip)
    _write_markers(urdf.root, {m: (on[m], placed[on[m]], at) for m, at in markers.items()})
    return _text(urdf.root)


def _text(root: Element) -> str:
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _write_markers(root: Element, markers: dict[str, tuple[str, Array, Array]]) -> None:
    """Links ``marker_<name>`` on a tip each, at points (3,) behind a transform (4, 4) of the tip."""
    for element in [e for e in root if e.get("name", "").startswith(MARKER)]:
        root.remove(element)  # of an earlier correction
    for name, (tip, T, position) in markers.items():
        SubElement(root, "link", name=MARKER + name)
        joint = SubElement(root, "joint", name=f"{MARKER}{name}_mount", type="fixed")
        _write_origin(joint, transform(T[:3, :3], transformed(T, position)))
        SubElement(joint, "parent", link=tip)
        SubElement(joint, "child", link=MARKER + name)


def _write_origin(element: Element, T: Array) -> None:
    """Set the <origin> of a joint or an inertial to a transform of shape (4, 4)."""
    origin = element.find("origin")
    if origin is None:
        origin = SubElement(element, "origin")
    origin.set("xyz", _words(T[:3, 3]))
    origin.set("rpy", _words(rpy_from_rotation(T[:3, :3])))


def _words(values: Array) -> str:
    """Numbers to 15 digits, as URDF attributes hold them."""
    return " ".join(f"{value + 0.0:.15g}" for value in values)  # no -0


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
        SubElement(joint, "axis", xyz=_words(robot.axes[k]))
        _limit(joint, robot, k)
        if robot.masses[k] > 0:
            inertial = SubElement(root[-1], "inertial")
            _write_origin(inertial, transform(np.eye(3), robot.coms[k]))
            SubElement(inertial, "mass", value=f"{robot.masses[k]:.15g}")
            SubElement(inertial, "inertia", _NO_INERTIA)
    _joint(root, _free_name(robot, "tip_mount"), link, robot.tip, origins[-1]).set("type", "fixed")
    _write_markers(root, {m: (robot.tip, np.eye(4), at) for m, at in markers.items()})
    return _text(root)


def _free_name(robot: Robot, name: str) -> str:
    """A name that neither the ends nor the joints of the chain bear."""
    while name in (robot.base, robot.tip, *robot.joints):
        name += "_"
    return name


def _joint(root: Element, name: str, parent: str, child: str, origin: Array) -> Element:
    """A joint and, after it, the link that it moves."""
    joint = SubElement(root, "joint", name=name)
    _write_origin(joint, origin)
    SubElement(joint, "parent", link=parent)
    SubElement(joint, "child", link=child)
    SubElement(root, "link", name=child)
    return joint


def _limit(joint: Element, robot: Robot, k: int) -> None:
    """Type and limits; a joint that slides needs limits in a URDF, and has wide ones without."""
    limited = bool(np.isfinite(robot.limits[k]).all())
    kind = "prismatic" if robot.prismatic[k] else "revolute" if limited else "continuous"
    joint.set("type", kind)
    effort = f"{np.nan_to_num(robot.efforts[k]):.15g}"
    limit = SubElement(joint, "limit", effort=effort, velocity="0")
    if limited or robot.prismatic[k]:
        low, high = np.clip(robot.limits[k], -_WIDE, _WIDE)
        limit.set("lower", f"{low:.15g}")
        limit.set("upper", f"{high:.15g}")
