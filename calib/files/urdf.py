"""Read a URDF: its links, joints, masses and collision shapes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path, PurePosixPath
from xml.etree.ElementTree import Element

import numpy as np

from calib.arm.robot import Robot, Source
from calib.arm.se3 import from_xyz_rpy, transformed
from calib.arrays import Array
from calib.errors import InputError
from calib.files.read import read_xml
from calib.files.shapes import mesh_vertices, spanned
from calib.files.tree import Joint, Shape, Tree, Weight
from calib.keys import fault_of_name

_LARGEST_NUMBER = 1e9  # in SI units


def load_urdf(path: str | Path, base: str, tip: str, others: Sequence[str] = ()) -> Robot:
    """The arm between links of a URDF. An effort or speed of 0 means: not given.

    Raises InputError for what is not well-formed, no way of revolute, continuous or prismatic joints,
    or not made of finite numbers.
    """
    return urdf_tree(Path(path), read_urdf(Path(path))).robot(base, tip, others)


def read_urdf(path: Path) -> Element:
    """The <robot> element. Raises InputError for what is no safe, well-formed URDF."""
    root = read_xml(path, "URDF")
    if root.tag != "robot":
        remedy = "expand a xacro file to a URDF with <robot> first"
        raise InputError(path, f"<{root.tag}>", "is not a URDF", remedy)
    return root


def urdf_tree(path: Path, root: Element) -> Tree:
    """What a <robot> element holds. Raises InputError, naming the element."""
    links = {link.get("name", ""): link for link in root.findall("link")}
    return Tree(
        Source("urdf", (path,)),
        root.get("name", ""),
        tuple(links),
        tuple(_joints(path, root)),
        tuple(_weights(path, links)),
        lambda name: _shapes(path, name, links[name]) if name in links else iter(()),
    )


def _numbers(path: Path, where: str, text: str, count: int = 3) -> Array:
    """So many finite numbers of a text."""
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError:
        what = f"{text!r} holds text in place of a number"
        raise InputError(path, where, what, "write numbers; expand a xacro file first") from None
    if len(values) != count or not np.isfinite(values).all():
        raise InputError(path, where, f"{text!r} should be {count} finite numbers")
    if (np.abs(values) > _LARGEST_NUMBER).any():
        raise InputError(path, where, f"{text!r} holds a number of no plausible size")
    return values


def _attribute(element: Element | None, key: str, default: str) -> str:
    """An attribute of an element that need not be there."""
    return default if element is None else element.get(key, default)


def _number(path: Path, where: str, element: Element | None, key: str, default: str = "0") -> float:
    return float(_numbers(path, where, _attribute(element, key, default), 1)[0])


def origin_of(path: Path, where: str, element: Element) -> Array:
    """The <origin> of an element as a transform, shape (4, 4), m. Raises InputError."""
    origin = element.find("origin")
    xyz, rpy = (
        _numbers(path, f"{where} origin {key}", _attribute(origin, key, "0 0 0"))
        for key in ("xyz", "rpy")
    )
    return from_xyz_rpy(xyz, rpy)


def _joints(path: Path, root: Element) -> Iterator[Joint]:
    moved: dict[str, str] = {}
    for element in root.findall("joint"):
        name = element.get("name", "")
        ends = [element.find("parent"), element.find("child")]
        where, (parent, child) = f"joint {name}", (_attribute(e, "link", "") for e in ends)
        if not name or None in ends:
            what = "lacks a name, a parent or a child"
            raise InputError(path, f"joint {name!r}", what, "add it")
        if fault := fault_of_name(name):
            raise InputError(path, f"joint {name!r}", f"the name {fault}", "name it plainly")
        if name in moved.values():
            raise InputError(path, where, "stands twice", "rename one of them")
        if child in moved:
            what = f"link {child!r} already hangs on joint {moved[child]!r}"
            remedy = (
                "links in a loop cannot be modelled: leave this joint out, and say in "
                "[robot.coupled] what moves the joints of the loop that have no drive"
            )
            raise InputError(path, where, what, remedy)
        moved[child] = name
        yield _joint(path, element, name, (parent, child))


def _joint(path: Path, element: Element, name: str, ends: tuple[str, str]) -> Joint:
    where, kind, limit = f"joint {name}", element.get("type", ""), element.find("limit")
    number = partial(_number, path, f"{where} limit", limit)
    limits = (-math.inf, math.inf)
    if limit is not None and kind != "continuous":
        limits = number("lower"), number("upper")
    mimic, dynamics = element.find("mimic"), element.find("dynamics")
    loss = partial(_number, path, f"{where} dynamics", dynamics)
    axis = _attribute(element.find("axis"), "xyz", "1 0 0")
    return Joint(
        name,
        kind,
        *ends,
        origin=origin_of(path, where, element),
        axis=_numbers(path, f"{where} axis", axis),
        limits=limits,
        effort=number("effort") or math.nan,
        speed=number("velocity") or math.nan,
        mimic=None
        if mimic is None
        else (
            mimic.get("joint", ""),
            _number(path, where, mimic, "multiplier", "1"),
            _number(path, where, mimic, "offset"),
        ),
        losses=(loss("damping"), loss("friction"), 0.0),
    )


def _weights(path: Path, links: dict[str, Element]) -> Iterator[Weight]:
    """Every link with an <inertial>."""
    for name, link in links.items():
        inertial, where = link.find("inertial"), f"link {name}"
        if inertial is not None:
            mass = _number(path, f"{where} mass", inertial.find("mass"), "value")
            if mass < 0:
                what = f"is negative ({mass:g} kg)"
                raise InputError(path, f"{where} mass", what, "correct it")
            T, tensor = origin_of(path, where, inertial), inertial.find("inertia")
            number = partial(_number, path, f"{where} inertia", tensor)
            xx, xy, xz, yy, yz, zz = (
                number(f"i{own}") for own in ("xx", "xy", "xz", "yy", "yz", "zz")
            )
            inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            yield Weight(name, mass, T[:3, 3], T[:3, :3] @ inertia @ T[:3, :3].T)


def _shapes(path: Path, name: str, link: Element) -> Iterator[Shape | str]:
    """Collision shapes of a link; what cannot be read is named with its reason."""
    for element in link.findall("collision"):
        try:
            points, radius = _spanned(path, f"link {name}", element)
            T = origin_of(path, f"link {name} collision", element)
        except InputError as error:
            yield f"{name} ({Path(error.file).name} {error.what})"
        else:
            yield transformed(T, points), radius


def _spanned(path: Path, where: str, collision: Element) -> Shape:
    """Points, and a radius about them, that hold the shape."""
    geometry = collision.find("geometry")
    shapes = [] if geometry is None else [e for e in geometry if isinstance(e.tag, str)]
    if len(shapes) != 1:
        raise InputError(path, where, "its collision has no geometry")
    (shape,) = shapes
    if shape.tag == "mesh":
        scale = _numbers(path, where, shape.get("scale", "1 1 1"))
        size = mesh_vertices(_mesh_file(path, shape.get("filename", ""))) * scale
    elif shape.tag == "box":
        size = 0.5 * _numbers(path, where, shape.get("size", ""))
    elif shape.tag in ("sphere", "cylinder", "capsule"):
        length = "radius" if shape.tag == "sphere" else "length"
        size = np.abs([_number(path, where, shape, key, "") for key in ("radius", length)]) * [
            1,
            0.5,
        ]
    else:
        raise InputError(path, where, f"{shape.tag!r} is no shape that can be read")
    return spanned(shape.tag, size)


def _mesh_file(path: Path, name: str) -> Path:
    """Where a mesh lies: beside the URDF, or in the package above or below a folder above it."""
    scheme, _, rest = name.rpartition("://")
    parts = PurePosixPath(rest).parts
    for folder in path.resolve().parents if scheme == "package" else ():
        for below in (parts, parts[1:]):
            if below and (file := folder.joinpath(*below)).is_file():
                return file
    return path.parent / rest
