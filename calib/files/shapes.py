"""Points that span the collision shapes of a robot's file, meshes too, and capsules around."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from calib.arm.se3 import even_directions
from calib.arrays import Array
from calib.errors import InputError
from calib.files.read import read_bytes

_LARGEST_FILE = 200_000_000  # bytes
_MOST = 1e6  # in the file's unit: no vertex of an arm is as far
_HEADER, _TRIANGLE = 84, 50  # bytes of a binary STL
_CORNERS = 24  # of the polygon about a circle: 0.9 % too wide
_SUPPORTS, _AXES = 300, 120  # directions: for the outer points, and tried as axis
_COARSE, _FINE = 20, 100  # steps towards the centre of the smallest circle
_WIDER = (1.0, 1.03, 1.1, 1.2, 1.4)  # a wider capsule of flat points is shorter
_MARGIN = 1e-9  # m: rounding leaves no point outside

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


# -- a capsule is convex: around points, it is around all that they span


def enclosing_capsule(points: Array) -> tuple[Array, Array, float]:
    """Ends of the axis (3,) and radius [m] of a small capsule that holds points (n, 3), m.

    The axis is the best by volume of many directions and of the points' principal ones; the circle
    about it is centred by Badoiu and Clarkson's steps (2003). All points are inside whatever the
    search found: radius and ends are taken from them last.
    """
    outer = points[np.unique(np.argmax(points @ even_directions(_SUPPORTS).T, axis=0))]
    principal = np.linalg.svd(outer - outer.mean(axis=0), full_matrices=False)[2]
    sphere = even_directions(_AXES)
    axes = np.concatenate([principal, np.eye(3), sphere[sphere[:, 2] >= 0.0]])
    centres = _centres(outer, axes, _COARSE)
    tried = [_capsule(outer, axis, centre) for axis, centre in zip(axes, centres, strict=True)]
    best = axes[[int(np.argmin([_volume(own) for own in tried]))]]
    (centre,) = _centres(outer, best, _FINE)
    start, end, radius = min((_capsule(points, best[0], centre, f) for f in _WIDER), key=_volume)
    return start, end, radius + _MARGIN


def _capsule(
    points: Array, axis: Array, centre: Array, factor: float = 1.0
) -> tuple[Array, Array, float]:
    """The shortest capsule along an axis (3,) about a centre, its circle widened by a factor."""
    along = points @ axis
    away = np.linalg.norm(points - centre - np.outer(along, axis), axis=1)
    radius = float(away.max()) * factor
    cap = np.sqrt(np.maximum(radius**2 - away**2, 0.0))
    low, high = float((along + cap).min()), float((along - cap).max())
    if low > high:
        low = high = 0.5 * (low + high)
    return centre + low * axis, centre + high * axis, radius


def _centres(points: Array, axes: Array, steps: int) -> Array:
    """Nearly the centre of the smallest circle about points (n, 3), seen along axes (a, 3)."""
    flat = points - (points @ axes.T).T[..., None] * axes[:, None]
    centres = flat.mean(axis=1)
    for step in range(1, steps):
        farthest = ((flat - centres[:, None]) ** 2).sum(axis=2).argmax(axis=1)
        centres += (flat[np.arange(len(axes)), farthest] - centres) / (step + 1)
    return np.asarray(centres)


def _volume(capsule: tuple[Array, Array, float]) -> float:
    start, end, radius = capsule
    return float(np.pi * radius**2 * (np.linalg.norm(end - start) + 4.0 / 3.0 * radius))
