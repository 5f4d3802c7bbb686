"""Write an MJCF with the identified geometry: the user's own file, or one made of a URDF."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from functools import reduce
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from calib.arm.robot import Robot
from calib.arm.se3 import displacement, inverse, rotate, transformed
from calib.arrays import Array
from calib.files.mjcf import MjcfBody, MjcfChain, compiled, mujoco_for
from calib.files.mjcf_tree import compiler_settings, joints_of, read_mjcf
from calib.files.urdf_out import MARKER

_ORIENTATIONS = ("quat", "axisangle", "xyaxes", "zaxis", "euler", "fromto")
_FOLDERS = ("meshdir", "texturedir")


def corrected_mjcf(
    source: str | Path,
    robot: Robot,
    corrections: Array,
    markers: dict[str, Array],
    target: Path,
    links: Mapping[str, str] | None = None,
) -> str:
    """The text of an MJCF whose bodies carry the identified geometry; all else stays.

    source : path of the nominal MJCF; what it includes is written in place
    corrections : ndarray, shape (F, 6), m and rad, displacement of each frame as in
        :class:`~calib.arm.robot.Robot`; that of the base is not part of the robot and is ignored
    markers : dict, name -> ndarray, shape (3,), m, tip frame: written as sites ``marker_<name>``
    links : dict, marker -> the tip on which it rides; ``robot.tip`` without
    target : Path, where the text is to be written; folders of meshes are named as seen from there

    A tip's displacement goes into the tip where it is a site, or a body without joints that carries no
    other way, else into the markers.
    """
    path = Path(source)
    root, _ = read_mjcf(path)
    chain = compiled(path, root, robot.base, robot.tip, robot.others)
    parents = {child: parent for parent in root.iter() for child in parent}
    in_frame = {e: inverse(chain.frames[p]) for e, p in parents.items() if p in chain.frames}
    frame = 0
    for body in chain.bodies:
        own = corrections[frame + 1 : frame + 1 + len(body.joints)]
        frame += len(body.joints)
        if own.any():
            _correct_body(body, own, in_frame)
    _remove_markers(parents, markers)
    for number, tip in enumerate(robot.tips, robot.dof + 1):
        at, T_tip = _correct_tip(chain, tip, corrections[number], in_frame)
        riding = {n: p for n, p in markers.items() if (links or {}).get(n, robot.tip) == tip}
        _write_markers(at, riding, T_tip)
    _name_folders(root, path.parent, target.parent)
    return _head(path) + ElementTree.tostring(root, encoding="unicode") + "\n"


def _correct_tip(
    chain: MjcfChain, tip: str, own: Array, in_frame: dict[Element, Array]
) -> tuple[Element, Array]:
    """Displace a tip; returns the body that holds it and its frame (4, 4) there as it then is."""
    at, T = chain.tips[tip]
    last, site = chain.bodies[at], chain.tree.tips[tip].site
    T_tip = T @ displacement(own)
    if site is not None:
        if own.any():
            _write_pose(site, T_tip, in_frame)
    elif not last.joints and all(body.parent != at for body in chain.bodies):
        if own.any():
            _write_pose(last.element, last.T @ displacement(own), in_frame)
        return last.element, np.eye(4)
    return last.element, T_tip


def _correct_body(body: MjcfBody, own: Array, in_frame: dict[Element, Array]) -> None:
    """Displace the joint frames of one body, ``T = B G_1 E_1 .. G_m E_m`` with G as body motions.

    That is ``B' E'_1 .. E'_m`` with ``B' = B G_1 .. G_m`` and each E' seen from behind the G that
    follow it: only the body's pose changes, and the axes of all joints but its last.
    """
    moves = [
        joint.origin @ displacement(xi) @ inverse(joint.origin)
        for joint, xi in zip(body.joints, own, strict=True)
    ]
    _write_pose(body.element, reduce(np.matmul, moves, body.T), in_frame)
    elements = {e.get("name"): e for e in joints_of(body.element)}
    H = np.eye(4)
    for joint, G in zip(body.joints[::-1], moves[::-1], strict=True):
        if not np.array_equal(H, np.eye(4)):
            element = elements[joint.name]
            seen = in_frame.get(element, np.eye(4)) @ H
            element.set("pos", _words(transformed(seen, joint.anchor)))
            element.set("axis", _words(rotate(seen[:3, :3], joint.axis)))
        H = H @ inverse(G)


def _write_pose(element: Element, T: Array, in_frame: dict[Element, Array]) -> None:
    import mujoco

    T = in_frame.get(element, np.eye(4)) @ T
    for key in _ORIENTATIONS:
        element.attrib.pop(key, None)
    element.set("pos", _words(T[:3, 3]))
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, T[:3, :3].flatten())
    element.set("quat", _words(quaternion))


def _remove_markers(parents: dict[Element, Element], markers: dict[str, Array]) -> None:
    """Those of an earlier correction."""
    names = {MARKER + name for name in markers}
    for element, parent in parents.items():
        if element.tag == "site" and element.get("name") in names:
            parent.remove(element)


def _write_markers(tip: Element, markers: dict[str, Array], T_tip: Array) -> None:
    for name, position in reversed(markers.items()):
        site = Element("site", name=MARKER + name, pos=_words(transformed(T_tip, position)))
        site.tail = tip.text
        tip.insert(0, site)


def _name_folders(root: Element, source: Path, target: Path) -> None:
    """Name the folders of meshes and textures as seen from the new folder."""
    if source.resolve() == target.resolve() or not any(e.get("file") for e in root.iter()):
        return
    settings = compiler_settings(root)
    for element in root.findall("compiler"):
        for key in (*_FOLDERS, "assetdir"):
            element.attrib.pop(key, None)
    seen = {}
    for key in _FOLDERS:
        folder = source / settings.get(key, settings.get("assetdir", ""))
        seen[key] = Path(os.path.relpath(folder.resolve(), target.resolve())).as_posix()
    root.insert(0, Element("compiler", seen))


def _head(path: Path) -> str:
    """Comments before the root, such as a licence, which an XML tree does not hold."""
    text = path.read_bytes().decode("utf-8-sig", "replace")
    prologue = re.match(r"(\s+|<\?.*?\?>|<!--.*?-->)*", text, re.DOTALL)
    comments = re.findall(r"<!--.*?-->", prologue.group() if prologue else "", re.DOTALL)
    return "".join(f"{comment}\n" for comment in comments)


def _words(values: Array) -> str:
    return " ".join(repr(float(value)) for value in values)


_KEPT = ("link", "joint")
_SHAPES = ("visual", "collision")
# Links without inertia, and inertias that no body can have, must not keep MuJoCo from reading it.
_LENIENT = {"boundmass": "1e-9", "boundinertia": "1e-9", "balanceinertia": "true"}


def mjcf_of_urdf(source: Path, text: str, tip: str) -> str:
    """The text of an MJCF with the chain, the branches and the inertias of a URDF.

    Marker links become sites of the tip. MuJoCo writes six digits: places, axes and ranges, which
    the calibration is about, are written anew from the compiled model.

    source : path that messages name
    text : the URDF
    tip : the link that carries the marker links

    Raises InputError where MuJoCo is not installed or refuses it.
    """
    root = ElementTree.fromstring(text)  # noqa: S314 - made by corrected_urdf
    for element in list(root):
        if element.tag not in _KEPT:
            root.remove(element)
        for shape in [child for child in element if child.tag in _SHAPES]:
            element.remove(shape)
    extension = SubElement(root, "mujoco")
    SubElement(extension, "compiler", _LENIENT | {"fusestatic": "false", "discardvisual": "false"})
    with mujoco_for(source) as mujoco:
        spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
        model = spec.compile()
        written = ElementTree.fromstring(spec.to_xml())  # noqa: S314 - made by MuJoCo
    for body in written.iter("body"):
        compiled = model.body(body.get("name"))
        _exact(body, pos=compiled.pos, quat=compiled.quat)
        for element in body.findall("joint"):
            joint = model.joint(element.get("name"))
            _exact(element, axis=joint.axis)
            if joint.limited[0]:
                _exact(element, range=joint.range)
    for body in written.iter("body"):
        if body.get("name") == tip:
            for marker in body.findall("body"):
                if marker.get("name", "").startswith(MARKER):
                    marker[:] = []
                    marker.tag = "site"
    ElementTree.indent(written)
    return ElementTree.tostring(written, encoding="unicode") + "\n"


def _exact(element: Element, **values: object) -> None:
    for key, numbers in values.items():
        element.set(key, " ".join(repr(float(x)) for x in numbers))  # type: ignore[attr-defined]
