"""Read a URDF: the joints from a link to others, a chain or a tree."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path, PurePosixPath
from xml.etree.ElementTree import Element

import numpy as np

from calib.arm.mimic import Mimic
from calib.arm.robot import Place, Robot, Source, weights_of
from calib.arm.se3 import from_xyz_rpy, transformed
from calib.arrays import Array
from calib.errors import InputError
from calib.files.read import read_xml
from calib.files.shapes import Span, mesh_vertices, shapes_of, spanned
from calib.keys import fault_of_name

_LARGEST_NUMBER = 1e9  # in SI units
_ROUNDED = 1e-9  # rad or m: limits that are as wide but for rounding
_MOST_JOINTS = 100  # that move
_MOVING = ("revolute", "continuous", "prismatic")


@dataclass(frozen=True, eq=False)
class UrdfJoint:
    """A <joint> of the file: name, type, and the links that it joins."""

    element: Element
    name: str
    kind: str
    parent: str
    child: str

    @property
    def moves(self) -> bool:
        """Whether it does."""
        return self.kind in _MOVING


@dataclass(frozen=True, eq=False)
class Urdf:
    """The <robot> element of a file, whose parts are checked as they are asked for.

    Every method raises InputError, naming the element, for what is missing or no number.
    """

    path: Path
    root: Element

    @classmethod
    def read(cls, path: Path) -> Urdf:
        """Raises InputError for what is no safe, well-formed URDF."""
        root = read_xml(path, "URDF")
        if root.tag != "robot":
            remedy = "expand a xacro file to a URDF with <robot> first"
            raise InputError(path, f"<{root.tag}>", "is not a URDF", remedy)
        return cls(path, root)

    def numbers(self, where: str, text: str, count: int = 3) -> Array:
        """So many finite numbers of a text."""
        try:
            values = np.array([float(word) for word in text.split()])
        except ValueError:
            what = f"{text!r} holds text in place of a number"
            remedy = "write numbers; expand a xacro file first"
            raise InputError(self.path, where, what, remedy) from None
        if len(values) != count or not np.isfinite(values).all():
            raise InputError(self.path, where, f"{text!r} should be {count} finite numbers")
        if (np.abs(values) > _LARGEST_NUMBER).any():
            raise InputError(self.path, where, f"{text!r} holds a number of no plausible size")
        return values

    def number(self, where: str, element: Element | None, key: str, default: str = "0") -> float:
        """A number of an element that need not be there."""
        return float(self.numbers(where, _attribute(element, key, default), 1)[0])

    def origin(self, where: str, element: Element) -> Array:
        """The <origin> of an element as a transform, shape (4, 4), m."""
        own = element.find("origin")
        xyz, rpy = (
            self.numbers(f"{where} origin {key}", _attribute(own, key, "0 0 0"))
            for key in ("xyz", "rpy")
        )
        return from_xyz_rpy(xyz, rpy)

    def origin_of(self, joint: UrdfJoint) -> Array:
        """The origin of a joint, shape (4, 4), m."""
        return self.origin(f"joint {joint.name}", joint.element)

    @cached_property
    def links(self) -> dict[str, Element]:
        """All of the file, by name."""
        return {link.get("name", ""): link for link in self.root.findall("link")}

    @cached_property
    def joints(self) -> dict[str, UrdfJoint]:
        """All of the file, by name."""
        joints: dict[str, UrdfJoint] = {}
        moved: dict[str, str] = {}
        for element in self.root.findall("joint"):
            name = element.get("name", "")
            ends = [element.find("parent"), element.find("child")]
            where, (parent, child) = f"joint {name!r}", (_attribute(e, "link", "") for e in ends)
            if not name or None in ends:
                raise InputError(self.path, where, "lacks a name, a parent or a child", "add it")
            if fault := fault_of_name(name):
                raise InputError(self.path, where, f"the name {fault}", "name it plainly")
            if name in joints:
                raise InputError(self.path, f"joint {name}", "stands twice", "rename one of them")
            if child in moved:
                what = f"link {child!r} already hangs on joint {moved[child]!r}"
                remedy = (
                    "links in a loop cannot be modelled: leave this joint out, and say in "
                    "[robot.coupled] what moves the joints of the loop that have no drive"
                )
                raise InputError(self.path, f"joint {name}", what, remedy)
            moved[child] = name
            joints[name] = UrdfJoint(element, name, element.get("type", ""), parent, child)
        return joints

    def chain(self, base: str, tip: str, others: Sequence[str] = ()) -> list[UrdfJoint]:
        """Joints from ``base`` to ``tip``, then those to other links: parents first, fixed ones too."""
        on = [("'on' of what it carries", other) for other in others]
        for key, name in (("[robot] base", base), ("[robot] tip", tip), *on):
            if name not in self.links:
                known = ", ".join([*self.links][:12]) or "none"
                remedy = f"set {key} to one of: {known}"
                raise InputError(self.path, "", f"has no link {name!r}", remedy)
        chain = list(dict.fromkeys(j for end in (tip, *others) for j in self._way(base, end)))
        for joint in chain:
            if not joint.moves and joint.kind != "fixed":
                what = f"type {joint.kind!r} is not supported"
                remedy = "use revolute, continuous, prismatic or fixed joints"
                raise InputError(self.path, f"joint {joint.name}", what, remedy)
        moving = sum(joint.moves for joint in chain)
        if not moving:
            what = "the chain has no moving joint"
            raise InputError(self.path, "", what, "check [robot] base and tip")
        if moving > _MOST_JOINTS:
            what = f"has {moving} moving joints, at most {_MOST_JOINTS} are possible"
            raise InputError(self.path, "", what, "fix the others")
        return chain

    def _way(self, base: str, tip: str) -> list[UrdfJoint]:
        """Joints of the only way from one link down to another."""
        by_child = {joint.child: joint for joint in self.joints.values()}
        way: list[UrdfJoint] = []
        link = tip
        while link != base:
            if link not in by_child or len(way) > len(by_child):
                what = f"no chain of joints leads from {base!r} to it (stopped at {link!r})"
                raise InputError(self.path, f"link {tip}", what, "check [robot] base and tip")
            way.append(by_child[link])
            link = by_child[link].parent
        return way[::-1]

    def places(self, base: str, chain: Sequence[UrdfJoint]) -> dict[str, Place]:
        """Where every link of the arm is; joints beside the chain, of any type, are held at zero."""
        places: dict[str, Place] = {base: (0, np.eye(4))}
        moving = 0
        for joint in chain:
            k, T = places[joint.parent]
            moving += joint.moves
            at = (moving, np.eye(4)) if joint.moves else (k, T @ self.origin_of(joint))
            places[joint.child] = at
        beside: dict[str, list[UrdfJoint]] = {}
        for joint in self.joints.values():
            beside.setdefault(joint.parent, []).append(joint)
        pending = list(places)
        for link in pending:  # grows as links are placed
            for joint in beside.get(link, ()):
                if joint.child not in places:
                    k, T = places[link]
                    places[joint.child] = k, T @ self.origin_of(joint)
                    pending.append(joint.child)
        return places


def _attribute(element: Element | None, key: str, default: str) -> str:
    """An attribute of an element that need not be there."""
    return default if element is None else element.get(key, default)


def load_urdf(path: str | Path, base: str, tip: str, others: Sequence[str] = ()) -> Robot:
    """Read the joints from link ``base`` to link ``tip``, and to other links that are tips as well.

    Fixed joints are folded into the next origin; masses and shapes that hang on a moving link by other
    joints than these, which are held at zero, are gathered into it. An effort or speed of 0 means: not
    given. A joint that mimics another stays a joint of the robot and follows its master.

    Raises InputError for what is not well-formed, no way of revolute, continuous or prismatic joints,
    or not made of finite numbers.
    """
    urdf = Urdf.read(Path(path))
    chain = urdf.chain(base, tip, others)
    weights = list(_weights(urdf))
    places = urdf.places(base, chain)
    moving = [joint for joint in chain if joint.moves]
    names = tuple(joint.name for joint in moving)
    hung = [(*places[joint.parent], urdf.origin_of(joint)) for joint in moving]
    hung += [(*places[link], np.eye(4)) for link in (*others, tip)]
    axes = np.array([_axis(urdf, joint) for joint in moving])
    limits, efforts, speeds = map(np.array, zip(*(_limits(urdf, j) for j in moving), strict=True))
    mimics = tuple(own for joint in moving if (own := _mimic(urdf, joint)) is not None)
    _keep_within_masters(urdf, mimics, names, limits)
    on_arm = ((places[link], mass, com) for link, mass, com in weights if link in places)
    masses, coms = weights_of(len(moving), on_arm)
    unread: list[str] = []
    return Robot(
        name=urdf.root.get("name", ""),
        base=base,
        tip=tip,
        joints=names,
        prismatic=np.array([joint.kind == "prismatic" for joint in moving]),
        origins=np.array([T @ own for _, T, own in hung]),
        axes=axes,
        limits=limits,
        efforts=efforts,
        speeds=speeds,
        masses=masses,
        coms=coms,
        mimics=mimics,
        shapes=shapes_of(names, _spans(urdf, places, unread), unread),
        source=Source("urdf", (urdf.path,)),
        others=tuple(others),
        parents=tuple(k for k, _, _ in hung),
    )


def _weights(urdf: Urdf) -> Iterator[tuple[str, float, Array]]:
    """Every link with an <inertial>: its name, mass [kg] and centre of mass (3,), m."""
    for name, link in urdf.links.items():
        inertial, where = link.find("inertial"), f"link {name}"
        if inertial is not None:
            mass = urdf.number(f"{where} mass", inertial.find("mass"), "value")
            if mass < 0:
                what = f"is negative ({mass:g} kg)"
                raise InputError(urdf.path, f"{where} mass", what, "correct it")
            yield name, mass, urdf.origin(where, inertial)[:3, 3]


def _mimic(urdf: Urdf, joint: UrdfJoint) -> Mimic | None:
    """What a joint follows, through masters that mimic others; None where it moves by itself."""
    where, name, factor, offset = f"joint {joint.name}", joint.name, 1.0, 0.0
    passed: list[str] = []
    while (mimic := urdf.joints[name].element.find("mimic")) is not None:
        passed.append(name)
        name = mimic.get("joint", "")
        offset += factor * urdf.number(where, mimic, "offset")
        factor *= urdf.number(where, mimic, "multiplier", "1")
        if name not in urdf.joints or not urdf.joints[name].moves or not factor:
            what = f"mimics {name!r}, which is no joint that moves it"
            remedy = "correct its <mimic>, or write it as a fixed joint"
            raise InputError(urdf.path, where, what, remedy)
        if name in passed:
            remedy = "let one of its masters move freely"
            raise InputError(urdf.path, where, "mimics itself", remedy)
    if not passed:
        return None
    return Mimic(joint.name, name, urdf.joints[name].kind == "prismatic", factor, offset)


def _keep_within_masters(
    urdf: Urdf, mimics: tuple[Mimic, ...], names: tuple[str, ...], limits: Array
) -> None:
    """Narrow limits (n, 2), in place, of joints whose master stands outside the chain, to its own.

    Raises InputError where the limits of a joint and of its master leave nothing.
    """
    for mimic in mimics:
        k, own = names.index(mimic.joint), np.array(_limits(urdf, urdf.joints[mimic.master])[0])
        given = np.sort(mimic.factor * own + mimic.offset)
        low, high = max(limits[k, 0], given[0]), min(limits[k, 1], given[1])
        if low > high + _ROUNDED:
            stated = f"{limits[k, 0]:g} .. {limits[k, 1]:g}"
            what = f"its limits, {stated}, are beyond those of its master"
            remedy = "correct its <limit> or <mimic>"
            raise InputError(urdf.path, f"joint {mimic.joint}", what, remedy)
        if mimic.master not in names:
            limits[k] = low, max(low, high)


def _axis(urdf: Urdf, joint: UrdfJoint) -> Array:
    where = f"joint {joint.name} axis"
    axis = urdf.numbers(where, _attribute(joint.element.find("axis"), "xyz", "1 0 0"))
    length = float(np.linalg.norm(axis))
    if length < 1e-9:
        raise InputError(urdf.path, where, "has no length", "name a direction")
    return axis / length


def _limits(urdf: Urdf, joint: UrdfJoint) -> tuple[tuple[float, float], float, float]:
    """Lower and upper limit, infinite without any; effort and speed, NaN where none is given."""
    limit, where = joint.element.find("limit"), f"joint {joint.name} limit"
    effort, speed = (urdf.number(where, limit, key) or math.nan for key in ("effort", "velocity"))
    if limit is None or joint.kind == "continuous":
        return (-math.inf, math.inf), effort, speed
    lower, upper = (urdf.number(where, limit, key) for key in ("lower", "upper"))
    if lower > upper:
        raise InputError(urdf.path, where, f"lower {lower} is above upper {upper}")
    return (lower, upper), effort, speed


def _spans(urdf: Urdf, places: dict[str, Place], unread: list[str]) -> Iterator[Span]:
    """Collision shapes of the arm's links; what cannot be read is named with its reason."""
    for name, place in places.items():
        for element in urdf.links[name].findall("collision") if name in urdf.links else ():
            where = f"link {name}"
            try:
                points, radius = _spanned(urdf, where, element)
                T = urdf.origin(f"{where} collision", element)
            except InputError as error:
                unread.append(f"{name} ({Path(error.file).name} {error.what})")
            else:
                yield place, transformed(T, points), radius


def _spanned(urdf: Urdf, where: str, collision: Element) -> tuple[Array, float]:
    """Points (n, 3), m, and a radius about them that hold the shape."""
    geometry = collision.find("geometry")
    shapes = [] if geometry is None else [own for own in geometry if isinstance(own.tag, str)]
    if len(shapes) != 1:
        raise InputError(urdf.path, where, "its collision has no geometry")
    (shape,) = shapes
    if shape.tag == "mesh":
        scale = urdf.numbers(where, shape.get("scale", "1 1 1"))
        size = mesh_vertices(_mesh_file(urdf.path, shape.get("filename", ""))) * scale
    elif shape.tag == "box":
        size = 0.5 * urdf.numbers(where, shape.get("size", ""))
    elif shape.tag in ("sphere", "cylinder", "capsule"):
        length = "radius" if shape.tag == "sphere" else "length"
        size = np.abs([urdf.number(where, shape, key, "") for key in ("radius", length)]) * [1, 0.5]
    else:
        raise InputError(urdf.path, where, f"{shape.tag!r} is no shape that can be read")
    return spanned(shape.tag, size)


def _mesh_file(path: Path, name: str) -> Path:
    """Where a mesh lies: beside the URDF, or in the package above or below a folder above it."""
    scheme, _, rest = name.rpartition("://")
    parts = PurePosixPath(rest).parts
    for folder in path.resolve().parents if scheme == "package" else ():
        for own in (parts, parts[1:]):
            if own and (file := folder.joinpath(*own)).is_file():
                return file
    return path.parent / rest
