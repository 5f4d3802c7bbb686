"""Points that span the collision shapes of a robot's file, meshes among them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from calib.arrays import Array
from calib.errors import InputError
from calib.files.read import read_bytes

_LARGEST_FILE = 200_000_000  # bytes
_MOST = 1e6  # in the file's unit: no vertex of an arm is as far
_HEADER, _TRIANGLE = 84, 50  # bytes of a binary STL
_CORNERS = 24  # of the polygon about a circle: 0.9 % too wide

SHAPES = ("box", "sphere", "capsule", "cylinder", "ellipsoid", "mesh")


def spanned(kind: str, size: Array) -> tuple[Array, float]:
    """Points (n, 3), m, and a radius [m] about them that hold a shape.

    kind : of ``SHAPES``; all others have no end
    size : half edges or half axes (3,), radius and half length, or the vertices (n, 3) of a mesh
    """
    along = np.outer([-1.0, 1.0], np.eye(3)[2])
    match kind:
        case "box":
            return np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T * size, 0.0
        case "sphere":
            return np.zeros((1, 3)), float(size[0])
        case "capsule":
            return along * size[1], float(size[0])
        case "cylinder":  # corners of polygons about both rims
            turn = 2.0 * np.pi * np.arange(_CORNERS) / _CORNERS
            rim = np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], axis=1)
            wide = rim * size[0] / np.cos(np.pi / _CORNERS)
            return np.concatenate([wide + end * size[1] for end in along]), 0.0
        case "ellipsoid":
            # The ball of the second axis, moved along the first: it meets the ellipsoid at its ends.
            long, middle = np.argsort(size)[[2, 1]]
            moved = np.eye(3)[long] * (size[long] - size[middle])
            return np.outer([-1.0, 1.0], moved), float(size[middle])
    return size, 0.0


def mesh_vertices(path: Path) -> Array:
    """The vertices (n, 3) in the file's unit. Raises InputError for what is no mesh, or not known."""
    kind = path.suffix.lower()
    if kind not in (".stl", ".obj"):
        raise InputError(path, "", "is no mesh that can be read", "bring it as STL or OBJ")
    try:
        content = read_bytes(path, _LARGEST_FILE)
    except InputError as error:
        what = error.what if "too large" in error.what else "is not there"
        raise InputError(path, "", what, "bring the file, or a coarser one") from None
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
