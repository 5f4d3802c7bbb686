"""The table of a camera in a cell: its lens and where it stands."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from calib.arm.se3 import inverse, so3_log
from calib.arrays import Array
from calib.files.values import (
    MM,
    BoardTable,
    BodyTable,
    Count,
    Name,
    NotNegative,
    Number,
    Positive,
    Range,
    TomlTable,
)
from calib.instruments.camera import FREE, ArmCamera, Camera, FixedCamera
from calib.instruments.detection import LEAST_MARKER, LEAST_SQUARE, Board, Detection
from calib.instruments.lens import Fisheye, Lens
from calib.instruments.protocol import WORLD, CellParts, KeysTable

_OF_FISHEYE = 4  # coefficients
_ROUNDED = 1e-10  # of a correlation
Pixels = tuple[Positive, Positive]
Coefficients = tuple[Number, Number, Number, Number] | tuple[Number, Number, Number, Number, Number]


class IntrinsicsStd(TomlTable):
    """Standard deviations of parts of a lens."""

    focal_px: Positive | None = None
    center_px: Positive | None = None
    distortion: Positive | Annotated[list[Positive], Field(min_length=4, max_length=5)] | None = (
        None
    )


class CameraTable(BodyTable, KeysTable):
    """A camera: its keys in a cell."""

    reads = "boards"
    kind: Literal["camera"]
    on: Name = WORLD
    boards: Annotated[list[Name], Field(min_length=1)] | None = None  # else all it may see
    calibration: str | None = None  # a file in place of the next three
    focal_px: Positive | Pixels = 1.0
    center_px: tuple[Number, Number] = (0.0, 0.0)
    distortion: Coefficients = (0.0, 0.0, 0.0, 0.0, 0.0)
    model: Literal["pinhole", "fisheye"] = (
        "pinhole"  # of the distortion: fisheye has k1, k2, k3, k4
    )
    image_px: Pixels | None = None
    sigma_px: Positive
    free: list[Literal["focal", "center", "distortion"]] = []
    intrinsics_std: (
        IntrinsicsStd | Annotated[list[NotNegative], Field(min_length=1, max_length=9)] | None
    ) = None  # in a list: fx, fy, cx, cy and the distortion; zero for what is known
    intrinsics_covariance: list[list[Number]] | None = None  # of the same values, with correlations
    margin_px: NotNegative = 10.0
    max_tilt_deg: Annotated[Positive, Field(lt=90)] = 60.0
    min_square_px: Positive | None = None
    min_points: Count | None = None
    focus_mm: Range = (0.0, 1e9)

    @model_validator(mode="after")
    def _one_lens(self) -> Self:
        keys = ("focal_px", "center_px", "distortion", "model")
        own = [k for k in keys if k in self.model_fields_set]
        if self.model == "fisheye" and "distortion" in own and len(self.distortion) != _OF_FISHEYE:
            raise ValueError("distortion of a fisheye is [k1, k2, k3, k4]; give these four")
        if self.calibration is not None and own:
            raise ValueError(f"has calibration and {own[0]}; keep one of them")
        if self.intrinsics_covariance is not None:
            rows = self.intrinsics_covariance
            square = all(len(row) == len(rows) for row in rows)
            if not square or not is_covariance(np.array(rows)):
                raise ValueError("intrinsics_covariance is no covariance of fx, fy, cx, cy, k1 ..")
            if self.intrinsics_std is not None:
                raise ValueError("has intrinsics_std and intrinsics_covariance; keep one of them")
        for key in ("focal_px", "center_px"):
            if self.calibration is None and key not in own:
                raise ValueError(f"lacks {key}; add it, or calibration = a YAML of OpenCV or ROS")
        return self

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
            boards.append(_board(own, table, slice(first, first + len(points)), points))
            targets += points_named
            if not carried:
                reads += range(cell.parts[own].start, cell.parts[own].stop)
        if carried:
            reads = [*range(cell.parts[name].start, cell.parts[name].stop)] * len(targets)
        lens = self._lens()
        covariance = self._covariance(len(lens.values))
        believed = _believed(self.intrinsics_std or IntrinsicsStd(), len(lens.values))
        if covariance is not None:
            variance = np.diag(covariance)
            believed = np.where(variance > 0.0, np.sqrt(variance), np.nan)
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
            believed_covariance=covariance,
            boards=tuple(boards),
            detection=Detection(
                self.margin_px,
                math.radians(self.max_tilt_deg),
                self.min_square_px,
                self.min_points,
                (self.focus_mm[0] * MM, self.focus_mm[1] * MM),
            ),
            standing=self._standing([*seen.values()], carried),
        )

    def _covariance(self, count: int) -> Array | None:
        """What is believed of the lens, with correlations, shape (count, count)."""
        if self.intrinsics_covariance is None:
            return None
        given = np.array(self.intrinsics_covariance)[:count, :count]
        return np.pad(given, (0, count - len(given)))

    def _lens(self) -> Lens:
        focal = self.focal_px if isinstance(self.focal_px, tuple) else (self.focal_px,) * 2
        if self.model == "fisheye":
            return Fisheye(np.array([*focal, *self.center_px, *self.distortion[:_OF_FISHEYE]]))
        return Lens(np.array([*focal, *self.center_px, *(*self.distortion, 0.0)[:5]]))

    def _standing(self, boards: Sequence[BodyTable], carried: bool) -> Array | None:
        """The place of the camera, or of the boards before which it is carried, if given."""
        still = boards if carried else [self]
        if not all(own.stated for own in still):
            return None
        places = [own.frame if carried else inverse(own.frame) for own in still]
        return np.concatenate([np.concatenate([T[:3, 3], so3_log(T[:3, :3])]) for T in places])


def is_covariance(given: Array) -> bool:
    """Whether a matrix (n, n) is symmetric, and no combination has a variance below zero."""
    variance = np.diag(given)
    if not len(given) or (variance < 0.0).any():
        return False
    scale = np.sqrt(np.where(variance > 0.0, variance, 1.0))
    shown = given / np.outer(scale, scale)
    return bool(np.allclose(shown, shown.T) and np.linalg.eigvalsh(shown).min() > -_ROUNDED)


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


_FEWEST, _SHARE = 4, 0.25  # points of a print with markers
_WHITE = 0.5  # squares of paper about a chessboard that its detector wants to see


def _board(name: str, table: BoardTable, channels: slice, points: Array) -> Board:
    """The board, with what OpenCV needs to find it: a chessboard whole, else some of its points.

    A marker is found whole or not at all, and a few are lost where board or camera stand a little
    aside: of a print with markers a quarter of the points must be seen. Where nobody said how it
    stands, nobody knows which way it faces.
    """
    if table.squares is not None and table.marker_mm is None:
        printed, square, least = (table.pitch_mm or 0.0) * MM, LEAST_SQUARE, len(points)
        near, (across, down) = -_WHITE, (n + _WHITE for n in table.squares)
        rim = printed * np.array(
            [[near, near, 0.0], [across, near, 0.0], [across, down, 0.0], [near, down, 0.0]]
        )
    else:
        printed, square = (table.marker_mm or table.tag_mm or 0.0) * MM, LEAST_MARKER
        least = max(_FEWEST, math.ceil(_SHARE * len(points))) if printed else 1
        rim = np.zeros((0, 3))
    if not table.stated:
        least, rim = 1, np.zeros((0, 3))
    return Board(name, channels, points, printed, square, least, rim, table.stated)
