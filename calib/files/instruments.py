"""The instruments of a cell file, and what stands on the tip for them to read."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from calib.arm.se3 import transformed
from calib.arrays import Array
from calib.errors import InputError
from calib.files.schema import CellFile
from calib.instruments import CellParts, Instrument, KnownDistance
from calib.instruments.board import BoardTable
from calib.instruments.keys_table import KeysTable
from calib.instruments.protocol import WORLD
from calib.instruments.riding import corners_of
from calib.instruments.socket import joined_sockets

_LARGEST_BOARD = 50.0  # m
_CORNERS = corners_of(np.eye(3), np.zeros(3))


@dataclass(frozen=True, eq=False)
class Bodies:
    """The bodies of a cell as markers that follow its own: frames, boards and cameras on links.

    parts : dict, name -> slice, positions of its points; names : tuple of str, of all of these markers
    seats : dict, link -> slice, the three points that stand for one on which an instrument rides
    markers : ndarray, shape (k, 3), m, each in the frame of its link; links : tuple of str, these
    shapes : dict, board -> names and points (n, 3), m, in its frame, of those on the tip and others
    """

    parts: Mapping[str, slice]
    seats: Mapping[str, slice]
    names: tuple[str, ...]
    markers: Array
    links: tuple[str, ...]
    shapes: Mapping[str, tuple[tuple[str, ...], Array]]


def bodies_of(path: Path, table: CellFile) -> Bodies:
    """The bodies after the markers; one of which nothing is said is guessed at its link's frame.

    Raises InputError for a board of which no point can be.
    """
    shapes = {name: _shape(path, name, board) for name, board in table.boards.items()}
    parts: dict[str, tuple[tuple[str, ...], Array, str]] = {
        name: ((name, f"{name}:x", f"{name}:y"), transformed(own.frame, _CORNERS), own.on)
        for name, own in {**table.bodies, **table.carried}.items()
    }
    for name, board in table.boards.items():
        if board.on != WORLD:
            points, shape = shapes[name]
            parts[name] = points, transformed(board.frame, shape), board.on
    under = {table.link(own.on): own.on for own in _seated(table).values()}
    ends = ("o", "x", "y")
    seats = {k: (tuple(f"{k}:{end}" for end in ends), _CORNERS, on) for k, on in under.items()}
    every = [*parts.values(), *seats.values()]
    counts = np.cumsum([len(table.markers_mm), *(len(names) for names, *_ in every)]).tolist()
    places = [slice(a, b) for a, b in itertools.pairwise(counts)]
    return Bodies(
        dict(zip(parts, places, strict=False)),
        dict(zip(seats, places[len(parts) :], strict=True)),
        tuple(name for names, *_ in every for name in names),
        np.concatenate([np.zeros((0, 3)), *(points for _, points, _ in every)]),
        tuple(table.link(on) for names, _, on in every for _ in names),
        shapes,
    )


def _seated(table: CellFile) -> dict[str, KeysTable]:
    """All other instruments that ride on links."""
    every = table.instruments.items()
    return {name: own for name, own in every if own.on != WORLD and name not in table.carried}


def _shape(path: Path, name: str, board: BoardTable) -> tuple[tuple[str, ...], Array]:
    """Names and points of a board; one that lies where no board reaches is none of it."""
    names, points = board.shape()
    near = np.abs(points - np.median(points, axis=0)).max(axis=1) < _LARGEST_BOARD
    if not near.any():
        what = "lie farther apart than those of any board"
        raise InputError(path, f"boards.{name}.points_mm", what, "give them in mm")
    return tuple(f"{name}:{own}" for own in itertools.compress(names, near)), points[near]


def instruments_of(path: Path, table: CellFile, bodies: Bodies) -> tuple[Instrument, ...]:
    """All of them; sockets of one uncertainty are one instrument that stands elsewhere each time.

    Raises InputError for one on a link that carries all that it could read, and for a camera where
    OpenCV is not installed.
    """
    if table.instrument is not None:
        return (table.instrument.tracker(),)
    for name in table.cameras if find_spec("cv2") is None else ():
        what = "is a camera, which needs OpenCV"
        raise InputError(path, f"instruments.{name}", what, "pip install '.[camera]'")
    cell = CellParts(
        links=tuple(own.on for own in table.markers_mm.values()),
        parts={**bodies.parts, **bodies.seats},
        read_as_poses={name: own.on for name, own in table.bodies.items()},
        boards={name: (table.boards[name], *shape) for name, shape in bodies.shapes.items()},
        placed="base" in table.model.effects,
    )
    made = {name: own.instrument(name, cell) for name, own in table.instruments.items()}
    for name, own in _seated(table).items():
        if made[name].markers == ():
            what = f"rides on {own.on} as all does that it reads"
            raise InputError(path, f"instruments.{name}.on", what, "name another link")
        made[name] = replace(made[name], seat=bodies.seats[table.link(own.on)])
    return joined_sockets([*made.values()])


def known_distances(path: Path, table: CellFile) -> tuple[KnownDistance, ...]:
    """Those of the cell. Raises InputError where one is not between two sockets or two markers."""
    sockets = [name for name, own in table.instruments.items() if own.kind == "socket"]
    on = {name: table.link(own.on) for name, own in table.markers_mm.items()}
    for number, own in enumerate(table.known_distances):
        (a, b), where = own.between, f"known_distances.{number}.between"
        if a in on and b in on and on[a] != on[b]:
            what = f"{a!r} and {b!r} ride on {on[a]} and {on[b]}, and are no known length apart"
            raise InputError(path, where, what, "take it out")
        if a == b or not any(a in names and b in names for names in (sockets, on)):
            what = f"{a!r} and {b!r} are not two sockets or two markers of the cell"
            known = ", ".join([*sorted(sockets), *on][:12])
            raise InputError(path, where, what, f"those are {known}")
    return tuple(table.known_distances)
