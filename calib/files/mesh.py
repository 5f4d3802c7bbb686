"""Vertices of a mesh: STL, binary or text, and OBJ."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from calib.arrays import Array
from calib.errors import InputError

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
