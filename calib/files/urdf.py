"""Read a URDF: the serial chain between two links."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from calib.arm.mimic import Mimic
from calib.arm.robot import Robot
from calib.arm.se3 import from_xyz_rpy, rotate
from calib.arrays import Array
from calib.errors import InputError
from calib.files.read import fault_of_name, read_xml

_LARGEST_NUMBER = 1e9  # in SI units
_ROUNDED = 1e-9  # rad or m: limits that are as wide but for rounding
_MOST_JOINTS = 100  # that move
MOVING = ("revolute", "continuous", "prismatic")


@dataclass(frozen=True)
class UrdfJoint:
    """A <joint> of the file: name, type, and the links that it joins."""

    element: ElementTree.Element
    name: str
    kind: str
    parent: str
    child: str


def parse(path: Path) -> ElementTree.Element:
    """The <robot> element. Raises InputError for what is no safe, well-formed URDF."""
    root = read_xml(path, "URDF")
    if root.tag != "robot":
        raise InputError(
            path,
            f"<{root.tag}>",
            "is not a URDF",
            "expand a xacro file to a URDF with <robot> first",
        )
    return root


def numbers(path: Path, where: str, text: str, count: int) -> Array:
    """So many finite numbers of a text. Raises InputError."""
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError:
        raise InputError(
            path,
            where,
            f"{text!r} holds text in place of a number",
            "write numbers; expand a xacro file first",
        ) from None
    if len(values) != count or not np.isfinite(values).all():
        raise InputError(path, where, f"{text!r} should be {count} finite numbers")
    if (np.abs(values) > _LARGEST_NUMBER).any():
        raise InputError(path, where, f"{text!r} holds a number of no plausible size")
    return values


def attribute(element: ElementTree.Element | None, key: str, default: str) -> str:
    """An attribute of an element that need not be there."""
    return default if element is None else element.get(key, default)


def origin_of(path: Path, where: str, element: ElementTree.Element) -> Array:
    """The <origin> of an element as a transform, shape (4, 4), m."""
    origin = element.find("origin")
    xyz = numbers(path, f"{where} origin xyz", attribute(origin, "xyz", "0 0 0"), 3)
    rpy = numbers(path, f"{where} origin rpy", attribute(origin, "rpy", "0 0 0"), 3)
    return from_xyz_rpy(xyz, rpy)


def _joints(path: Path, root: ElementTree.Element) -> dict[str, UrdfJoint]:
    """Joints by the link that they move."""
    by_child: dict[str, UrdfJoint] = {}
    names: set[str] = set()
    for element in root.findall("joint"):
        name = element.get("name", "")
        parent, child = element.find("parent"), element.find("child")
        if not name or parent is None or child is None:
            raise InputError(path, f"joint {name!r}", "lacks a name, a parent or a child", "add it")
        if fault := fault_of_name(name):
            raise InputError(path, f"joint {name!r}", f"the name {fault}", "name it plainly")
        joint = UrdfJoint(
            element, name, element.get("type", ""), parent.get("link", ""), child.get("link", "")
        )
        if name in names:
            raise InputError(path, f"joint {name}", "stands twice", "rename one of them")
        names.add(name)
        if joint.child in by_child:
            raise InputError(
                path,
                f"joint {name}",
                f"link {joint.child!r} already hangs on joint {by_child[joint.child].name!r}",
                "closed loops are not supported; model the serial chain",
            )
        by_child[joint.child] = joint
    return by_child


def chain_of(path: Path, root: ElementTree.Element, base: str, tip: str) -> list[UrdfJoint]:
    """Joints from link ``base`` to link ``tip``. Raises InputError if they are no serial chain."""
    links = [link.get("name", "") for link in root.findall("link")]
    for key, name in (("base", base), ("tip", tip)):
        if name not in links:
            known = ", ".join(links[:12]) or "none"
            raise InputError(
                path, "", f"has no link {name!r}", f"set [robot] {key} to one of: {known}"
            )
    by_child = _joints(path, root)
    chain: list[UrdfJoint] = []
    link = tip
    while link != base:
        if link not in by_child or len(chain) > len(by_child):
            raise InputError(
                path,
                f"link {tip}",
                f"no chain of joints leads from {base!r} to it (stopped at {link!r})",
                "check [robot] base and tip",
            )
        chain.append(by_child[link])
        link = by_child[link].parent
    chain.reverse()
    _refuse_unsupported(path, chain)
    return chain


def _refuse_unsupported(path: Path, chain: list[UrdfJoint]) -> None:
    for joint in chain:
        if joint.kind not in (*MOVING, "fixed"):
            raise InputError(
                path,
                f"joint {joint.name}",
                f"type {joint.kind!r} is not supported",
                "use revolute, continuous, prismatic or fixed joints",
            )
    if not any(joint.kind in MOVING for joint in chain):
        raise InputError(path, "", "the chain has no moving joint", "check [robot] base and tip")


def carried(
    path: Path, root: ElementTree.Element, chain: list[UrdfJoint], first: tuple[str, ...] = ()
) -> list[tuple[str, str, Array]]:
    """(link on the chain, link, transform) of links that hang on the chain, rigidly.

    Joints beside the chain, of whatever type, and beyond its tip are held at zero.

    first : links beside those that joints of the chain move
    """
    on_chain = (*first, *(joint.child for joint in chain))
    placed = {link: (link, np.eye(4)) for link in on_chain}
    beside: dict[str, list[UrdfJoint]] = {}
    for joint in _joints(path, root).values():
        beside.setdefault(joint.parent, []).append(joint)
    pending = list(placed)
    for link in pending:  # grows as links are placed
        for joint in beside.get(link, ()):
            if joint.child not in placed:
                carrier, T = placed[link]
                own = origin_of(path, f"joint {joint.name}", joint.element)
                placed[joint.child] = (carrier, T @ own)
                pending.append(joint.child)
    return [(carrier, link, T) for link, (carrier, T) in placed.items()]


def _inertials(path: Path, root: ElementTree.Element) -> dict[str, tuple[float, Array]]:
    found = {}
    for link in root.findall("link"):
        inertial = link.find("inertial")
        if inertial is None:
            continue
        where = f"link {link.get('name')}"
        text = attribute(inertial.find("mass"), "value", "0")
        mass = float(numbers(path, f"{where} mass", text, 1)[0])
        if mass < 0:
            raise InputError(path, f"{where} mass", f"is negative ({mass:g} kg)", "correct it")
        found[link.get("name", "")] = (mass, origin_of(path, where, inertial)[:3, 3])
    return found


def load_urdf(path: str | Path, base: str, tip: str) -> Robot:
    """Read the serial chain from link ``base`` to link ``tip``.

    Fixed joints are folded into the next origin; masses that hang on a moving link by other joints
    than the chain's, which are held at zero, are gathered into it. The effort limit 0 means: not given.
    A joint that mimics another stays a joint of the chain and follows its master.

    Raises InputError for what is not well-formed, not a serial chain of revolute, continuous or
    prismatic joints, or not made of finite numbers.
    """
    path = Path(path)
    root = parse(path)
    chain = chain_of(path, root, base, tip)
    weights = _inertials(path, root)
    hanging = carried(path, root, chain)

    moving = [joint for joint in chain if joint.kind in MOVING]
    n = len(moving)
    if n > _MOST_JOINTS:
        what = f"has {n} moving joints, at most {_MOST_JOINTS} are possible"
        raise InputError(path, "", what, "fix the others")
    origins, axes = np.empty((n + 1, 4, 4)), np.empty((n, 3))
    limits, efforts = np.full((n, 2), [-np.inf, np.inf]), np.full(n, np.nan)
    masses, moments = np.zeros(n), np.zeros((n, 3))
    C, k = np.eye(4), -1
    for joint in chain:
        C = C @ origin_of(path, f"joint {joint.name}", joint.element)
        if joint.kind in MOVING:
            k += 1
            origins[k], axes[k] = C, _axis(path, joint)
            limits[k], efforts[k] = _limits(path, joint)
            C = np.eye(4)
        for mass, moment in _hung(joint.child, C, hanging, weights) if k >= 0 else ():
            masses[k] += mass
            moments[k] += moment
    origins[n] = C
    mimics = tuple(m for joint in moving if (m := _mimic(path, root, joint)) is not None)
    _keep_within_masters(path, root, mimics, [joint.name for joint in moving], limits)
    coms = moments / np.where(masses == 0, 1.0, masses)[:, None]
    return Robot(
        name=root.get("name", ""),
        base=base,
        tip=tip,
        joints=tuple(joint.name for joint in moving),
        prismatic=np.array([joint.kind == "prismatic" for joint in moving]),
        origins=origins,
        axes=axes,
        limits=limits,
        efforts=efforts,
        masses=masses,
        coms=coms,
        mimics=mimics,
    )


def _hung(
    carrier: str,
    placed: Array,
    hanging: list[tuple[str, str, Array]],
    weights: dict[str, tuple[float, Array]],
) -> Iterator[tuple[float, Array]]:
    """Mass and first moment, kg m, of all that hangs on a link, where the link is placed so."""
    for own, link, T in hanging:
        if own == carrier and link in weights:
            mass, com = weights[link]
            at = placed @ T
            yield mass, mass * (rotate(at[:3, :3], com) + at[:3, 3])


def _mimic(path: Path, root: ElementTree.Element, joint: UrdfJoint) -> Mimic | None:
    """What a joint follows, through masters that mimic others; None where it moves by itself."""
    elements = {element.get("name", ""): element for element in root.findall("joint")}
    where, name, factor, offset = f"joint {joint.name}", joint.name, 1.0, 0.0
    passed: list[str] = []
    while (mimic := elements[name].find("mimic")) is not None:
        passed.append(name)
        name = mimic.get("joint", "")
        offset += factor * float(numbers(path, where, mimic.get("offset", "0"), 1)[0])
        factor *= float(numbers(path, where, mimic.get("multiplier", "1"), 1)[0])
        if name not in elements or elements[name].get("type") not in MOVING or not factor:
            what = f"mimics {name!r}, which is no joint that moves it"
            raise InputError(path, where, what, "correct its <mimic>, or write it as a fixed joint")
        if name in passed:
            raise InputError(path, where, "mimics itself", "let one of its masters move freely")
    if not passed:
        return None
    return Mimic(joint.name, name, elements[name].get("type") == "prismatic", factor, offset)


def _keep_within_masters(
    path: Path,
    root: ElementTree.Element,
    mimics: tuple[Mimic, ...],
    names: list[str],
    limits: Array,
) -> None:
    """Narrow limits (n, 2), in place, of joints whose master stands outside the chain, to its own.

    Raises InputError where the limits of a joint and of its master leave nothing.
    """
    masters = {joint.name: joint for joint in _joints(path, root).values()}
    for mimic in mimics:
        k, own = names.index(mimic.joint), np.array(_limits(path, masters[mimic.master])[0])
        given = np.sort(mimic.factor * own + mimic.offset)
        low, high = max(limits[k, 0], given[0]), min(limits[k, 1], given[1])
        if low > high + _ROUNDED:
            what = (
                f"its limits, {limits[k, 0]:g} .. {limits[k, 1]:g}, are beyond those of its master"
            )
            raise InputError(path, f"joint {mimic.joint}", what, "correct its <limit> or <mimic>")
        if mimic.master not in names:
            limits[k] = low, max(low, high)


def _axis(path: Path, joint: UrdfJoint) -> Array:
    text = attribute(joint.element.find("axis"), "xyz", "1 0 0")
    axis = numbers(path, f"joint {joint.name} axis", text, 3)
    length = float(np.linalg.norm(axis))
    if length < 1e-9:
        raise InputError(path, f"joint {joint.name} axis", "has no length", "name a direction")
    return axis / length


def _limits(path: Path, joint: UrdfJoint) -> tuple[tuple[float, float], float]:
    limit = joint.element.find("limit")
    if limit is None:
        return (-math.inf, math.inf), math.nan
    where = f"joint {joint.name} limit"
    effort = float(numbers(path, where, limit.get("effort", "0"), 1)[0])
    if joint.kind == "continuous":
        return (-math.inf, math.inf), effort or math.nan
    lower = float(numbers(path, where, limit.get("lower", "0"), 1)[0])
    upper = float(numbers(path, where, limit.get("upper", "0"), 1)[0])
    if lower > upper:
        raise InputError(path, where, f"lower {lower} is above upper {upper}")
    return (lower, upper), effort or math.nan
