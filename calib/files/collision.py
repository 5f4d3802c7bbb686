"""Capsules of the arm from the collision shapes of a URDF, one for each shape."""

from __future__ import annotations

from pathlib import Path, PurePosixPath
from xml.etree.ElementTree import Element

import numpy as np

from calib.arm.enclosing import enclosing_capsule
from calib.arm.robot import Capsule, Shapes
from calib.arm.se3 import rotate
from calib.arrays import Array
from calib.errors import InputError
from calib.files.mesh import mesh_vertices
from calib.files.urdf import (
    MOVING,
    UrdfJoint,
    attribute,
    carried,
    chain_of,
    numbers,
    origin_of,
    parse,
)

_CORNERS = 24  # of the polygon about a circle: 0.9 % too wide


def urdf_shapes(path: Path, base: str, tip: str) -> Shapes:
    """Capsules by the joint that carries them, or ``base``, in the frame that turns with the joint.

    Each holds its shape. A shape that cannot be read is named with its reason and left out.
    """
    root = parse(path)
    chain = chain_of(path, root, base, tip)
    links = {link.get("name", ""): link for link in root.findall("link")}
    capsules: dict[str, list[Capsule]] = {}
    unread, lowest = [], []
    for link, (carrier, T) in _places(path, root, chain, base).items():
        for element in links[link].findall("collision") if link in links else ():
            try:
                points, radius = _spanned(path, f"link {link}", element)
                T_own = T @ origin_of(path, f"link {link} collision", element)
            except InputError as error:
                unread.append(f"{link} ({Path(error.file).name} {error.what})")
                continue
            points = rotate(T_own[:3, :3], points) + T_own[:3, 3]
            if carrier == "base":
                lowest.append(float(points[:, 2].min()) - radius)
            capsules.setdefault(carrier, []).append(capsule_about(points, radius))
    found = {name: tuple(own) for name, own in capsules.items()}
    return Shapes(found, tuple(unread), min(lowest, default=None))


def _places(
    path: Path, root: Element, chain: list[UrdfJoint], base: str
) -> dict[str, tuple[str, Array]]:
    """Carrier of every link of the arm, and the link's frame in the carrier's, shape (4, 4)."""
    places = {base: ("base", np.eye(4))}
    carrier, T = "base", np.eye(4)
    for joint in chain:
        T = T @ origin_of(path, f"joint {joint.name}", joint.element)
        if joint.kind in MOVING:
            carrier, T = joint.name, np.eye(4)
        places[joint.child] = (carrier, T)
    for on, link, own in carried(path, root, chain, (base,)):
        places[link] = (places[on][0], places[on][1] @ own)
    return places


def capsule_about(points: Array, radius: float) -> Capsule:
    """A small capsule about balls of a radius at points (n, 3), m."""
    start, end, wide = enclosing_capsule(points)
    (a, b, c), (d, e, f) = start.tolist(), end.tolist()
    return Capsule((a, b, c), (d, e, f), wide + radius)


def _spanned(path: Path, where: str, collision: Element) -> tuple[Array, float]:
    """Points (n, 3), m, and a radius about them that hold the shape."""
    geometry = collision.find("geometry")
    shapes = [] if geometry is None else [own for own in geometry if isinstance(own.tag, str)]
    if len(shapes) != 1:
        raise InputError(path, where, "its collision has no geometry")
    (shape,) = shapes

    def number(key: str) -> float:
        return float(abs(numbers(path, where, attribute(shape, key, ""), 1)[0]))

    if shape.tag == "box":
        return corners(0.5 * numbers(path, where, attribute(shape, "size", ""), 3)), 0.0
    if shape.tag == "sphere":
        return np.zeros((1, 3)), number("radius")
    if shape.tag == "cylinder":
        return rims(number("radius"), 0.5 * number("length")), 0.0
    if shape.tag == "capsule":
        return np.outer([-0.5, 0.5], [0.0, 0.0, number("length")]), number("radius")
    if shape.tag == "mesh":
        scale = numbers(path, where, attribute(shape, "scale", "1 1 1"), 3)
        return mesh_vertices(_mesh_file(path, shape.get("filename", ""))) * scale, 0.0
    raise InputError(path, where, f"{shape.tag!r} is no shape that can be read")


def corners(half: Array) -> Array:
    """Those of a box with half edges (3,), shape (8, 3)."""
    return np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T * half


def rims(radius: float, half: float) -> Array:
    """Corners of polygons about both rims of a cylinder along z, shape (n, 3)."""
    wide, turn = radius / np.cos(np.pi / _CORNERS), 2.0 * np.pi * np.arange(_CORNERS) / _CORNERS
    rim = np.column_stack([wide * np.cos(turn), wide * np.sin(turn), np.full(_CORNERS, half)])
    return np.concatenate([rim, rim * [1.0, 1.0, -1.0]])


def _mesh_file(path: Path, name: str) -> Path:
    """Where a mesh lies: beside the URDF, or in the package above or below a folder above it."""
    scheme, _, rest = name.rpartition("://")
    if scheme != "package":
        return path.parent / rest
    parts = PurePosixPath(rest).parts
    for folder in path.resolve().parents:
        for own in (parts, parts[1:]):
            if own and (found := folder.joinpath(*own)).is_file():
                return found
    return path.parent / rest
