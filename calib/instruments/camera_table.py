"""The table of a camera in a cell: its lens and where it stands."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from calib.arm.se3 import inverse, so3_log
from calib.arrays import Array
from calib.instruments.board_table import BoardTable, BodyTable
from calib.instruments.camera import FREE, ArmCamera, Camera, FixedCamera
from calib.instruments.detection import LEAST_MARKER, LEAST_SQUARE, Board
from calib.instruments.lens import Lens
from calib.instruments.protocol import WORLD, CellParts, KeysTable
from calib.keys import MM, Count, Name, NotNegative, Number, Positive, TomlTable, Vector

Pixels = tuple[Positive, Positive]
Coefficients = tuple[Number, Number, Number, Number] | tuple[Number, Number, Number, Number, Number]


class IntrinsicsStd(TomlTable):
    """Standard deviations of parts of a lens."""

    focal_px: Positive | None = None
    """standard deviation of the focal length"""
    center_px: Positive | None = None
    """standard deviation of the principal point"""
    distortion: Positive | Annotated[list[Positive], Field(min_length=4, max_length=5)] | None = (
        None
    )
    """standard deviation of the coefficients"""


class CameraTable(BodyTable, KeysTable):
    """A camera: its keys in a cell."""

    reads = "boards"
    kind: Literal["camera"]
    position_mm: Vector = (0.0, 0.0, 0.0)
    """camera: position, in the frame of its link or the base"""
    rpy_deg: Vector = (0.0, 0.0, 0.0)
    """camera: orientation, z ahead and x to the right of the image"""
    on: Name = WORLD
    """where it is fixed: world, tip, or a link of the robot"""
    boards: Annotated[list[Name], Field(min_length=1)] | None = None
    """camera: boards that it looks at; without it all that do not ride with it"""
    focal_px: Positive | Pixels
    """camera: focal length, one number or two"""
    center_px: tuple[Number, Number]
    """camera: principal point"""
    distortion: Coefficients = (0.0, 0.0, 0.0, 0.0, 0.0)
    """camera: k1 k2 p1 p2 k3, as OpenCV"""
    image_px: Pixels | None = None
    """camera: size of the image"""
    sigma_px: Positive
    """camera: one standard deviation of one coordinate, of a board that looks large (`posecal
    explain camera`)"""
    free: list[Literal["focal", "center", "distortion"]] = []
    """camera: parts of the lens that are identified"""
    intrinsics_std: (
        IntrinsicsStd | Annotated[list[NotNegative], Field(min_length=1, max_length=9)] | None
    ) = None
    """camera: standard deviation of the lens values; a list is fx fy cx cy k1 k2 p1 p2 k3"""
    max_tilt_deg: Annotated[Positive, Field(lt=90)] = 60.0
    """camera: largest angle between the line of sight and a board's normal in a plan"""
    min_points: Count | None = None
    """camera: fewest points by which a plan counts a board; without it all of a chessboard"""

    def seen(self, boards: Mapping[str, BoardTable]) -> dict[str, BoardTable]:
        """The boards that it looks at: those that it names, else all that do not ride with it."""
        named = [*boards] if self.boards is None else self.boards
        return {n: boards[n] for n in named if n in boards and boards[n].on != self.on}

    def rides_before(self, boards: Mapping[str, BoardTable]) -> bool:
        """Whether it rides on a link and boards that it sees of these stand in the world."""
        return self.on != WORLD and any(own.on == WORLD for own in self.seen(boards).values())

    def instrument(self, name: str, cell: CellParts) -> Camera:
        """One of boards in the world, that it rides before, or of what rides elsewhere than itself."""
        every = {own: table for own, (table, *_) in cell.boards.items()}
        seen, carried = self.seen(every), self.rides_before(every)
        boards: list[Board] = []
        reads = [] if carried else [j for j, on in enumerate(cell.links) if on != self.on]
        beside = len(reads)
        targets: list[str] = []
        for own, table in seen.items():
            _, points_named, points = cell.boards[own]
            first = beside + len(targets)
            boards.append(
                _board(own, table, slice(first, first + len(points)), points, self.min_points)
            )
            targets += points_named
            if not carried:
                reads += range(cell.parts[own].start, cell.parts[own].stop)
        if carried:
            reads = [*range(cell.parts[name].start, cell.parts[name].stop)] * len(targets)
        lens = self._lens()
        believed = _believed(self.intrinsics_std or IntrinsicsStd(), len(lens.values))
        free = np.isfinite(believed)
        for part in self.free:
            free[FREE[part]] = True
        return (ArmCamera if carried else FixedCamera)(
            name=name,
            markers=tuple(reads),
            targets=tuple(targets) if carried else (),
            lens=lens,
            sigma=self.sigma_px,
            image=None if self.image_px is None else np.array(self.image_px),
            free=np.flatnonzero(free),
            believed=believed,
            boards=tuple(boards),
            tilt=math.radians(self.max_tilt_deg),
            standing=self._standing([*seen.values()], carried),
        )

    def _lens(self) -> Lens:
        focal = self.focal_px if isinstance(self.focal_px, tuple) else (self.focal_px,) * 2
        return Lens(np.array([*focal, *self.center_px, *(*self.distortion, 0.0)[:5]]))

    def _standing(self, boards: Sequence[BodyTable], carried: bool) -> Array | None:
        """The place of the camera, or of the boards before which it is carried, if given."""
        still = boards if carried else [self]
        if not all(own.stated for own in still):
            return None
        places = [own.frame if carried else inverse(own.frame) for own in still]
        return np.concatenate([np.concatenate([T[:3, 3], so3_log(T[:3, :3])]) for T in places])


def _believed(given: IntrinsicsStd | list[float], count: int) -> Array:
    """Standard deviations of a lens's values, shape (count,), NaN where none is given, or zero."""
    found = np.full(count, np.nan)
    if isinstance(given, list):
        known = np.array(given[:count])
        found[: len(known)] = np.where(known > 0.0, known, np.nan)
        return found
    parts = zip(FREE.values(), (given.focal_px, given.center_px, given.distortion), strict=True)
    for part, std in parts:
        if std is not None:
            several = [*std, *std[-1:] * 5] if isinstance(std, list) else [std] * 5
            found[part] = several[: len(found[part])]
    return found


def _board(
    name: str, table: BoardTable, channels: slice, points: Array, least: int | None
) -> Board:
    """The board; least : points by which it counts, by default all of a chessboard.

    Where nobody said how it stands, nobody knows which way it faces.
    """
    chessboard = table.squares is not None and table.marker_mm is None
    side = table.pitch_mm if chessboard else table.marker_mm or table.tag_mm
    square = LEAST_SQUARE if chessboard else LEAST_MARKER
    every = len(points) if chessboard and table.stated else 1
    least = every if least is None else min(least, len(points))
    return Board(name, channels, points, (side or 0.0) * MM, square, least, table.stated)
