"""Capsules of the arm from the collision shapes of a URDF or an MJCF, one for each shape."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path, PurePosixPath
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from calib.arm.enclosing import enclosing_capsule
from calib.arm.robot import Capsule, Place, Shapes
from calib.arm.se3 import transformed
from calib.arrays import Array
from calib.errors import InputError
from calib.files.mjcf import body_of, chain_of, compiled, placed, places_of
from calib.files.urdf import Urdf

_LARGEST_FILE = 200_000_000  # bytes
_MOST = 1e6  # in the file's unit: no vertex of an arm is as far
_HEADER, _TRIANGLE = 84, 50  # bytes of a binary STL
_CORNERS = 24  # of the polygon about a circle: 0.9 % too wide


def shapes_of(
    joints: Sequence[str], spans: Iterable[tuple[Place, Array, float]], unread: list[str]
) -> Shapes:
    """Capsules by the joint that carries them, or ``base``: one about each span.

    spans : place of a link, and points (n, 3), m, in its frame with a radius [m] about them
    unread : shapes that are none of these; may grow while spans are taken
    """
    capsules: dict[str, list[Capsule]] = {}
    for (k, T), local, radius in spans:
        points = transformed(T, local)
        start, end, wide = enclosing_capsule(points)
        (a, b, c), (d, e, f) = start.tolist(), end.tolist()
        own = capsules.setdefault(("base", *joints)[k], [])
        own.append(Capsule((a, b, c), (d, e, f), wide + radius))
    found = {name: tuple(own) for name, own in capsules.items()}
    return Shapes(found, tuple(unread))


def corners(half: Array) -> Array:
    """Those of a box with half edges (3,), shape (8, 3)."""
    return np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T * half


def rims(radius: float, half: float) -> Array:
    """Corners of polygons about both rims of a cylinder along z, shape (n, 3)."""
    wide, turn = radius / np.cos(np.pi / _CORNERS), 2.0 * np.pi * np.arange(_CORNERS) / _CORNERS
    rim = np.column_stack([wide * np.cos(turn), wide * np.sin(turn), np.full(_CORNERS, half)])
    return np.concatenate([rim, rim * [1.0, 1.0, -1.0]])


def ends(half: float) -> Array:
    """Ends of a stretch along z, shape (2, 3)."""
    return np.outer([-half, half], [0.0, 0.0, 1.0])


def urdf_shapes(path: Path, base: str, tip: str, others: Sequence[str] = ()) -> Shapes:
    """Capsules by the joint that carries them, or ``base``, in the frame that turns with the joint.

    Each holds its shape. A shape that cannot be read is named with its reason and left out.
    """
    urdf = Urdf.read(path)
    chain = urdf.chain(base, tip, others)
    links = {link.get("name", ""): link for link in urdf.root.findall("link")}
    unread: list[str] = []

    def spans() -> Iterator[tuple[Place, Array, float]]:
        for link, place in urdf.places(base, chain).items():
            for element in links[link].findall("collision") if link in links else ():
                try:
                    points, radius = _spanned(urdf, f"link {link}", element)
                    T = urdf.origin(f"link {link} collision", element)
                except InputError as error:
                    unread.append(f"{link} ({Path(error.file).name} {error.what})")
                else:
                    yield place, transformed(T, points), radius

    return shapes_of([joint.name for joint in chain if joint.moves], spans(), unread)


def _spanned(urdf: Urdf, where: str, collision: Element) -> tuple[Array, float]:
    """Points (n, 3), m, and a radius about them that hold the shape."""
    geometry = collision.find("geometry")
    shapes = [] if geometry is None else [own for own in geometry if isinstance(own.tag, str)]
    if len(shapes) != 1:
        raise InputError(urdf.path, where, "its collision has no geometry")
    (shape,) = shapes

    def number(key: str) -> float:
        return abs(urdf.number(where, shape.get(key, "")))

    match shape.tag:
        case "box":
            return corners(0.5 * urdf.numbers(where, shape.get("size", ""))), 0.0
        case "sphere":
            return np.zeros((1, 3)), number("radius")
        case "cylinder":
            return rims(number("radius"), 0.5 * number("length")), 0.0
        case "capsule":
            return ends(0.5 * number("length")), number("radius")
        case "mesh":
            scale = urdf.numbers(where, shape.get("scale", "1 1 1"))
            return mesh_vertices(_mesh_file(urdf.path, shape.get("filename", ""))) * scale, 0.0
    raise InputError(urdf.path, where, f"{shape.tag!r} is no shape that can be read")


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


def mjcf_shapes(path: Path, base: str, tip: str, others: Sequence[str] = ()) -> Shapes:
    """The same of an MJCF.

    A geom that touches nothing (``contype`` and ``conaffinity`` zero) is a picture and left out. Bodies
    beside the chain are held as they are drawn. A geom that no capsule holds, such as a plane, is named
    with its reason.
    """
    try:
        model = compiled(path)
    except InputError as error:
        return Shapes({}, (f"its geoms ({error.what})",))
    import mujoco

    first = body_of(path, model, base)
    chain = chain_of(path, model, first, (tip, *others))
    places, unread = places_of(model, first, chain), []

    def spans() -> Iterator[tuple[Place, Array, float]]:
        for g in np.flatnonzero((model.geom_contype | model.geom_conaffinity) != 0):
            body = int(model.geom_bodyid[g])
            if body == 0 or body not in places:  # what the world holds is none of the arm's
                continue
            spanned = _spanned_by_geom(mujoco, model, int(g))
            if spanned is None:
                kind = mujoco.mjtGeom(int(model.geom_type[g])).name.removeprefix("mjGEOM_")
                unread.append(f"{model.body(body).name} ({kind.lower()} has no end)")
                continue
            T = placed(model.geom_pos[g], model.geom_quat[g])
            yield places[body], transformed(T, spanned[0]), spanned[1]

    joints = [model.joint(j).name for b in chain for j in np.flatnonzero(model.jnt_bodyid == b)]
    return shapes_of(joints, spans(), unread)


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
        return ends(b), a
    if kind == Geom.mjGEOM_ELLIPSOID:
        # The ball of the second axis, moved along the first: it meets the ellipsoid at its ends.
        half = model.geom_size[g]
        long, middle = np.argsort(half)[[2, 1]]
        moved = np.eye(3)[long] * (half[long] - half[middle])
        return np.outer([-1.0, 1.0], moved), float(half[middle])
    if kind == Geom.mjGEOM_MESH:
        mesh = model.mesh(int(model.geom_dataid[g]))
        begin, count = int(mesh.vertadr[0]), int(mesh.vertnum[0])
        return np.array(model.mesh_vert[begin : begin + count], dtype=float), 0.0
    return None


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
