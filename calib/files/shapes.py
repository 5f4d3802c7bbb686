"""Capsules of the arm from the collision shapes of a URDF or an MJCF, one for each shape."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from calib.arm.enclosing import enclosing_capsule
from calib.arm.robot import Capsule, Shapes
from calib.arm.se3 import rotate
from calib.arrays import Array
from calib.errors import InputError
from calib.files.mjcf import mujoco_for, placed, shifted
from calib.files.mjcf_tree import WORLD
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

_LARGEST_FILE = 200_000_000  # bytes
_MOST = 1e6  # in the file's unit: no vertex of an arm is as far
_HEADER, _TRIANGLE = 84, 50  # bytes of a binary STL


def mesh_vertices(path: Path) -> Array:
    """The vertices (n, 3) in the file's unit. Raises InputError for what is no mesh, or not known."""
    kind = path.suffix.lower()
    if kind not in (".stl", ".obj"):
        raise InputError(path, "", "is no mesh that can be read", "bring it as STL or OBJ")
    try:
        if path.stat().st_size > _LARGEST_FILE:
            raise InputError(path, "", "is too large for a mesh of a link", "bring a coarser one")
        content = path.read_bytes()
    except (OSError, ValueError):
        raise InputError(path, "", "is not there", "bring the file") from None
    try:
        found = _stl(content) if kind == ".stl" else _rows_after(content, b"v")
    except (ValueError, IndexError):
        raise InputError(path, "", "is no well-formed mesh", "export it again") from None
    if len(found) < 1 or not (np.abs(found) < _MOST).all():  # NaN is not below
        raise InputError(path, "", "has no vertices of a plausible size", "export it again")
    return found


def _stl(content: bytes) -> Array:
    """Binary where the length says so: text files begin with "solid", and some binary ones, too."""
    count = int.from_bytes(content[80:84], "little")
    if len(content) >= _HEADER and len(content) == _HEADER + _TRIANGLE * count:
        triangle = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])
        corners = np.frombuffer(content, triangle, count, _HEADER)["corners"]
        return np.asarray(corners, dtype=float).reshape(-1, 3)
    return _rows_after(content, b"vertex")


def _rows_after(content: bytes, word: bytes) -> Array:
    """Three numbers of every line that begins with a word."""
    lines = (line.split() for line in content.splitlines())
    rows = [line[1:4] for line in lines if line[:1] == [word]]
    return np.array(rows, dtype=float).reshape(-1, 3)


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


def mjcf_shapes(path: Path, base: str, tip: str) -> Shapes:
    """Capsules by the joint that carries them, or ``base``, in the frame that turns with the joint.

    Each holds its geom; one that touches nothing (``contype`` and ``conaffinity`` zero) is a picture
    and left out. Bodies beside the chain are held as they are drawn. A geom that no capsule holds,
    such as a plane, is named with its reason.
    """
    try:
        with mujoco_for(path) as mujoco:
            model = mujoco.MjModel.from_xml_path(str(path))
    except InputError as error:
        return Shapes({}, (f"its geoms ({error.what})",))
    capsules: dict[str, list[Capsule]] = {}
    unread, lowest = [], []
    frames = _frames(model, base, tip)
    for g in np.flatnonzero((model.geom_contype | model.geom_conaffinity) != 0):
        body = int(model.geom_bodyid[g])
        if body not in frames:
            continue
        spanned = _spanned_by_geom(mujoco, model, int(g))
        if spanned is None:
            unread.append(f"{model.body(body).name} ({_kind(mujoco, model, int(g))} has no end)")
            continue
        carrier, T = frames[body]
        T = T @ placed(model.geom_pos[g], model.geom_quat[g])
        points = rotate(T[:3, :3], spanned[0]) + T[:3, 3]
        if carrier == "base":
            lowest.append(float(points[:, 2].min()) - spanned[1])
        capsules.setdefault(carrier, []).append(capsule_about(points, spanned[1]))
    found = {name: tuple(own) for name, own in capsules.items()}
    return Shapes(found, tuple(unread), min(lowest, default=None))


def _frames(model: Any, base: str, tip: str) -> dict[int, tuple[str, Array]]:
    """Of every body of the arm its carrier, and its frame in the carrier's, shape (4, 4).

    Of the world itself nothing belongs to the arm, and what stands there neither: the floor, tables.
    """
    first = 0 if base == WORLD else model.body(base).id
    chain = [*_up_to(model, _body_of(model, tip), first)][::-1]
    frames: dict[int, tuple[str, Array]] = {first: ("base", np.eye(4))}
    for i in range(1, model.nbody):  # parents come first
        parent, joints = int(model.body_parentid[i]), np.flatnonzero(model.jnt_bodyid == i)
        if i == first or parent not in frames or (i not in chain and parent == 0):
            continue
        carrier, T = frames[parent]
        T = T @ placed(model.body_pos[i], model.body_quat[i])
        if len(joints) and i in chain:
            carrier, T = model.joint(joints[-1]).name, shifted(-model.jnt_pos[joints[-1]])
        frames[i] = carrier, T
    return {body: own for body, own in frames.items() if body}


def _body_of(model: Any, tip: str) -> int:
    try:
        return int(model.body(tip).id)
    except KeyError:
        return int(model.site_bodyid[model.site(tip).id])


def _up_to(model: Any, body: int, first: int) -> Iterator[int]:
    """Bodies from the tip's up to the base, itself left out."""
    while body != first:
        yield body
        body = int(model.body_parentid[body])


def _spanned_by_geom(mujoco: Any, model: Any, g: int) -> tuple[Array, float] | None:
    """Points (n, 3), m, in the geom's frame, and a radius about them; None of what has no end."""
    Geom, (a, b, c) = mujoco.mjtGeom, model.geom_size[g].tolist()
    kind = model.geom_type[g]
    if kind == Geom.mjGEOM_BOX:
        return corners(np.array([a, b, c])), 0.0
    if kind == Geom.mjGEOM_SPHERE:
        return np.zeros((1, 3)), a
    if kind == Geom.mjGEOM_CYLINDER:
        return rims(a, b), 0.0
    if kind == Geom.mjGEOM_CAPSULE:
        return np.outer([-b, b], [0.0, 0.0, 1.0]), a
    if kind == Geom.mjGEOM_ELLIPSOID:
        return _ellipsoid(model.geom_size[g])
    if kind == Geom.mjGEOM_MESH:
        mesh = model.mesh(int(model.geom_dataid[g]))
        begin, count = int(mesh.vertadr[0]), int(mesh.vertnum[0])
        return np.array(model.mesh_vert[begin : begin + count], dtype=float), 0.0
    return None


def _ellipsoid(half: Array) -> tuple[Array, float]:
    """The ball of the second axis, moved along the first: it meets the ellipsoid at its ends."""
    first, second = np.argsort(half)[[2, 1]]
    return np.outer([-1.0, 1.0], np.eye(3)[first] * (half[first] - half[second])), float(
        half[second]
    )


def _kind(mujoco: Any, model: Any, g: int) -> str:
    name = mujoco.mjtGeom(int(model.geom_type[g])).name
    return str(name.removeprefix("mjGEOM_").lower())
