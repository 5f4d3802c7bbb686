"""The robot as URDF or MJCF with the links and losses that motions gave; its geometry stays."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Literal
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np
from defusedxml.ElementTree import fromstring

from calib.arm.robot import Robot
from calib.arm.se3 import inverse, rpy_from_rotation
from calib.arrays import Array
from calib.cell import Cell
from calib.errors import InputError
from calib.files.mjcf import mjcf_tree
from calib.files.read import read_xml
from calib.files.robot_out import Written, corrected_robot, words_of
from calib.files.tree import gathered
from calib.files.urdf import read_urdf, urdf_tree
from calib.motion.effects import EFFECTS
from calib.motion.gram import LOSSES
from calib.motion.held import Held
from calib.motion.physical import pseudo_inertias
from calib.motion.regressor import TENSOR, nominal_inertials

_FULL = ("xx", "yy", "zz", "xy", "xz", "yz")  # of an MJCF's fullinertia
_IN_BODIES = ".//body//joint"


def own_links(robot: Robot) -> tuple[Array, Array]:
    """The link of the file that each joint moves, without those that are fixed to it.

    Returns inertial parameters (n, 10) in the frames of the joints, NaN where there is none, as between
    two joints of one body, and the frames (n, 4, 4), m, of the links in these.

    Raises InputError where the file cannot be read any more.
    """
    if robot.source.form == "dh":
        return nominal_inertials(robot), np.tile(np.eye(4), (robot.dof, 1, 1))
    path = robot.source.files[0]
    of_urdf = robot.source.form == "urdf"
    tree = urdf_tree(path, read_urdf(path)) if of_urdf else mjcf_tree(path)[0]
    chain = tree.chain(robot.base, robot.tip, robot.others)
    # In an MJCF joints are within bodies: a joint's own link is nameless, and named after the body.
    own = [j.child if of_urdf else j.child.rpartition(" of ")[2] for j in chain if j.moves]
    places = tree.places(robot.base, chain)
    masses, coms, inertias = gathered(robot.dof, [w for w in tree.weights if w.link in own], places)
    links = nominal_inertials(replace(robot, masses=masses, coms=coms, inertias=inertias))
    links[[places[link][0] != k for k, link in enumerate(own, 1)]] = np.nan
    return links, np.array([places[link][1] for link in own])


def robot_with(cell: Cell, held: Held, form: Literal["urdf", "mjcf"], target: Path) -> Written:
    """The robot's file with other links and losses; made anew, a bare chain, where it has another form.

    Raises InputError where its file cannot be read any more, or does not let these be written.
    """
    robot, lacks = cell.robot, list[str]()
    own, frames = own_links(robot)
    anew = robot.source.form != form
    if anew:
        own, frames = nominal_inertials(robot), np.tile(np.eye(4), (robot.dof, 1, 1))
        lacks.append(
            f"is made anew from the {robot.source}: the bare chain, without shapes and couplings"
        )
    if form == "mjcf":
        root = _bare_mjcf(robot, cell.gravity) if anew else _own_mjcf(robot)
    elif anew:
        nothing = np.zeros((robot.frame_count, 6))
        root = fromstring(corrected_robot(cell, nothing, {}, target).text)
    else:
        root = read_urdf(robot.source.files[0])
    names = [getattr(EFFECTS[kind], form) for kind in LOSSES]
    for k, (joint, link) in enumerate(_joints(root, robot)):
        if anew or held.links[k].any():
            T = inverse(frames[k])
            (P,) = T @ pseudo_inertias((own + held.links)[[k]]) @ T.T
            _write_inertial(link, P, form)
        values = dict(zip(names, (f"{v:.15g}" for v in held.losses[k].tolist()), strict=True))
        dynamics = joint.find("dynamics")
        if form == "urdf" and dynamics is None:
            dynamics = SubElement(joint, "dynamics")
        (joint if dynamics is None else dynamics).attrib |= {n: v for n, v in values.items() if n}
    if form == "urdf" and held.losses[:, 2].any():
        each = zip(robot.joints, held.losses[:, 2].tolist(), strict=True)
        values_of = ", ".join(f"{name} {value:.4g}" for name, value in each)
        lacks.append(f"has no place for armatures: set {values_of} kg m^2 in the simulator")
    ElementTree.indent(root)
    text = ElementTree.tostring(root, encoding="unicode", xml_declaration=True)
    return Written(text + "\n", tuple(lacks))


def _joints(root: Element, robot: Robot) -> Iterator[tuple[Element, Element]]:
    """The element of each joint, and that of the link or body that it moves."""
    found = [
        *root.findall("joint"),
        *root.findall(_IN_BODIES),
    ]  # not those of defaults and equalities
    elements = {element.get("name"): element for element in found}
    links = {element.get("name"): element for element in root.findall("link")}
    above = {below: element for element in root.iter() for below in element}
    for name in robot.joints:
        joint = elements[name]
        child, body = joint.find("child"), above[joint]
        while child is None and body.tag != "body":
            body = above[body]
        yield joint, body if child is None else links[child.get("link")]


def _write_inertial(link: Element, P: Array, form: str) -> None:
    """Set the inertial of a link or body by its pseudo-inertia (4, 4); one without mass has none."""
    for old in link.findall("inertial"):
        link.remove(old)
    mass = float(P[3, 3])
    if not mass:
        return
    com = P[:3, 3] / mass
    spread = P[:3, :3] - mass * np.outer(com, com)
    inertia = np.trace(spread) * np.eye(3) - spread
    moments = {"xyz"[i] + "xyz"[j]: f"{inertia[i, j]:.15g}" for i, j in TENSOR}
    if form == "mjcf":
        full = " ".join(moments[axes] for axes in _FULL)
        own = Element("inertial", pos=words_of(com), mass=f"{mass:.15g}", fullinertia=full)
    else:
        own = Element("inertial")
        SubElement(own, "origin", xyz=words_of(com), rpy="0 0 0")
        SubElement(own, "mass", value=f"{mass:.15g}")
        SubElement(own, "inertia", {f"i{axes}": value for axes, value in moments.items()})
    link.insert(0, own)


def _own_mjcf(robot: Robot) -> Element:
    """The robot's MJCF. Raises InputError where another file holds the arm, or masses are no masses."""
    path = robot.source.files[0]
    root = read_xml(path, "MJCF")
    named = {element.get("name") for element in root.findall(_IN_BODIES)}
    if beyond := [name for name in robot.joints if name not in named]:
        what = f"takes joint {beyond[0]!r} from another file"
        raise InputError(path, "", what, "name the file that holds the arm in the cell")
    for own in root.iter("compiler"):
        if own.get("inertiafromgeom") == "true" or "settotalmass" in own.attrib:
            what = "inertiafromgeom or settotalmass overrules masses that are written"
            raise InputError(path, "<compiler>", what, "remove it")
    return root


def _bare_mjcf(robot: Robot, gravity: Array) -> Element:
    """The chain with its limits: bodies named as their joints, tips as sites."""
    root = Element("mujoco", model=robot.name)
    SubElement(root, "compiler", angle="radian", autolimits="true", eulerseq="XYZ")
    SubElement(root, "option", gravity=words_of(gravity))
    bodies = [SubElement(root, "worldbody")]
    names = (*robot.joints, *robot.tips)
    for k, (name, parent, T) in enumerate(zip(names, robot.parents, robot.origins, strict=True)):
        place = {"pos": words_of(T[:3, 3]), "euler": words_of(rpy_from_rotation(T[:3, :3]))}
        below = SubElement(bodies[parent], "site" if k >= robot.dof else "body", place, name=name)
        if k < robot.dof:
            bodies.append(below)
            kind = "slide" if robot.prismatic[k] else "hinge"
            joint = SubElement(below, "joint", name=name, type=kind, axis=words_of(robot.axes[k]))
            if np.isfinite(robot.limits[k]).all():
                joint.set("range", words_of(robot.limits[k]))
            if np.isfinite(robot.efforts[k]):
                joint.set("actuatorfrcrange", words_of(robot.efforts[k] * np.array([-1.0, 1.0])))
    return root
