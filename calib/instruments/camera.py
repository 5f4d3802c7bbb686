"""A camera: pixels of points on the tip, seen from the world, or of a board, seen from the tip."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, ClassVar, Literal, NamedTuple, Self

import numpy as np
from pydantic import Field

from calib.arm.se3 import displaced_shape, inverse, moved_as_one, rotate, so3_exp
from calib.arrays import Array, IntArray, Mask
from calib.instruments.board import Board, BoardTable
from calib.instruments.keys_table import BodyTable, CellParts, KeysTable
from calib.instruments.lens import CENTER, DISTORTION, FOCAL, Lens
from calib.instruments.protocol import (
    FRAME,
    MOTION,
    SCALE,
    WORLD,
    Component,
    Instrument,
    Linear,
    Nominal,
    ReadingColumn,
    Start,
    Unknown,
)
from calib.instruments.resection import Mounted, Resected, Ridden, on_tip, resected
from calib.instruments.riding import CORNERS, by_corners, corners_of, frame_of, twist_of
from calib.keys import (
    DEG,
    Count,
    Name,
    Number,
    Positive,
    TomlTable,
    Vector,
    Written,
    key,
    times,
)

_BEFORE = 2e-3  # m
_BENT = 0.1  # plausible size of a coefficient of distortion
_OFF = 0.02  # of the focal length: plausible error of it and of the centre
FREE = {"focal": FOCAL, "center": CENTER, "distortion": DISTORTION}
"""Parts of a lens that may be unknown, by their names in a cell."""


class Sight(NamedTuple):
    """Points (..., m, C, 3), m, in the axes of a camera, and their derivatives.

    by_points : by the points that readings take, (..., m or 1, C or 1, 3, 3 k)
    by_standing, by_loose : by where it, or its boards, stand, and by how far these came loose
    """

    points: Array
    by_points: Array
    by_standing: Array
    by_loose: Array


@dataclass(frozen=True, eq=False)
class Camera(Instrument):
    """A pinhole with its lens. The place ends with what is unknown of the lens, beyond the given.

    sigma : float, px, of a coordinate; image : ndarray, shape (2,), px, its size, or None
    free : ndarray of int, positions of the unknown values of the lens
    believed : ndarray, shape (9,), standard deviations of the lens's values, NaN where none is given
    boards : tuple of Board, that it sees; tilt : rad, by which one that is seen leans at most
    standing : shape (6,), where it stands, or (6 boards,), where these do
    """

    lens: Lens = field(default_factory=Lens)
    sigma: float = 1.0
    image: Array | None = None
    free: IntArray = field(default_factory=lambda: np.zeros(0, dtype=int))
    believed: Array = field(default_factory=lambda: np.full(9, np.nan))
    boards: tuple[Board, ...] = ()
    tilt: float = float(np.radians(60.0))
    kind: ClassVar[str] = "camera"
    rows: ClassVar[int] = 2
    columns: ClassVar[tuple[ReadingColumn, ...]] = tuple(ReadingColumn(c, "pixel") for c in "uv")
    numbers: ClassVar[tuple[Component, ...]] = tuple(Component(c, "px", 1.0) for c in "uv")
    given_by: ClassVar[str] = "position_mm and rpy_deg"
    loose: ClassVar[slice | None] = MOTION

    @property
    def of_lens(self) -> tuple[Unknown, ...]:
        """What is unknown of the lens."""
        off = _OFF * float(self.lens.values[FOCAL].mean())
        kinds = [*[("px", 1.0, off)] * DISTORTION.start, *[("", 1.0, _BENT)] * 5]
        return tuple(Unknown(self.lens.names[i], *kinds[i]) for i in self.free.tolist())

    @property
    def belief(self) -> Array:
        std = np.concatenate(
            [np.full(len(self.unknowns) - len(self.free), np.nan), self.believed[self.free]]
        )
        known = np.isfinite(std)
        return np.asarray(np.diag(1.0 / np.where(known, std, 1.0))[known])

    @property
    def metric(self) -> bool:
        return bool(self.boards)

    def whitening(self, place: Array, rows: Array, sigma: Array) -> Array:
        """Even in both directions; it grows as figures look smaller, unless sigma says it, px."""
        del place
        usual = np.full(rows.shape[:-1], self.sigma)
        for board in self.boards:
            usual[..., board.channels] *= board.noise(rows[..., board.channels, :])[..., None]
        own = np.where(np.isnan(sigma), usual, sigma)[..., None, None]
        return np.broadcast_to(np.eye(2) / own, (*rows.shape, 2))

    def found_at(self, place: Array) -> Self:
        return replace(self, standing=place[: len(self.unknowns) - len(self.free)])

    @abstractmethod
    def sight(self, standing: Array, points: Array, loose: Array) -> Sight:
        """What points (..., m, C, 3 k), m, base axes, show from where it, or its boards, stand.

        loose : ndarray, shape (..., n), how far its boards are from there
        """

    def linearise(self, place: Array, points: Array) -> Linear:
        standing, lens, loose = self.split(place)
        seen = self.sight(standing, points, loose[..., MOTION.stop :])
        own, turn, by_motion = seen.points, np.eye(3), np.zeros((*seen.points.shape, 0))
        if loose.shape[-1]:  # what it sees moves as one
            own, turn, by_motion = moved_as_one(loose[..., None, MOTION], own)
        rows, by_own, by_lens = lens.linearise(own)
        by_seen = by_own @ turn if loose.shape[-1] else by_own
        of_lens = by_lens[..., self.free]
        by = [by_seen @ seen.by_standing, of_lens, by_own @ by_motion, by_seen @ seen.by_loose]
        return Linear(rows, by_seen @ seen.by_points, np.concatenate(by, axis=-1))

    @abstractmethod
    def sees_from(self, board: Board, point: int) -> Array | None:
        """The end (3,) in the world, m, base axes, of the line of sight to a point of a board.

        None where it is not known. The other end is on the arm.
        """

    def found(self, points: Array) -> Mask:
        """Which of the readings (m, C) count, of points (m, C, 3 k), m, base axes."""
        if self.standing is None:
            return np.ones(points.shape[:-1], dtype=bool)
        viewed = self.sight(self.standing, points, np.zeros(0)).points
        seen = np.asarray(viewed[..., 2] > 0.0)
        if self.image is not None:
            pixels = self.lens.project(viewed)
            seen &= ((pixels >= 0.0) & (pixels <= self.image)).all(axis=-1)
        for board in self.boards:
            own = (slice(None), board.channels)
            seen[own] = board.found(viewed[own], seen[own], self.tilt)
        return seen

    def resected(self, rows: Array, seen: Mask, mounted: Mounted) -> tuple[Resected, Array]:
        """Places from which the rays fit, and what is unknown of the lens, of the same focal length."""
        focal = bool(np.isin(np.arange(FOCAL.stop), self.free).all())
        places = resected(self.lens.ideal(rows), seen, mounted, focal)
        by = np.zeros(len(self.lens.values))
        by[FOCAL] = (places.focal - 1.0) * self.lens.values[FOCAL]
        return places, by[self.free]

    def split(self, place: Array) -> tuple[Array, Lens, Array]:
        """Where the camera, or its boards, stand; the lens; and what came loose."""
        count = len(self.unknowns)
        standing = count - len(self.free)
        if not len(self.free):
            return place[..., :standing], self.lens, place[..., count:]
        by = np.zeros((*place.shape[:-1], len(self.lens.values)))
        by[..., self.free] = place[..., standing:count]
        return place[..., :standing], self.lens.moved(by), place[..., count:]


@dataclass(frozen=True, eq=False)
class FixedCamera(Camera):
    """In the world, of markers and boards on the tip. The place begins with ``T_camera_base``."""

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        return (*FRAME, *self.of_lens)

    def sight(self, standing: Array, points: Array, loose: Array) -> Sight:
        own, R, by_standing = moved_as_one(standing[..., None, :], points)
        return Sight(own, R, by_standing, np.zeros((*own.shape, loose.shape[-1])))

    def start(self, rows: Array, seen: Mask, arm: Nominal) -> Start:
        """Where the rays of all images meet what rides on the tip."""
        bodies = on_tip(arm, tuple((board.channels, board.points) for board in self.boards))
        guess = np.zeros(6) if self.standing is None or arm.placed else self.standing
        camera = so3_exp(guess[3:]), guess[:3]
        mounted = Mounted((arm.R_tip, arm.p_tip), bodies, camera, arm.placed)
        places, lens = self.resected(rows, seen, mounted)
        markers, told = arm.markers.copy(), np.zeros_like(arm.free)
        for body, (R, t) in zip(bodies, places.bodies, strict=True):
            channels = body.channels
            if not body.known and seen[:, channels].any():
                markers[channels], told[channels] = body.points @ R.T + t, arm.free[channels]
        return Start(np.concatenate([twist_of(places.R, places.t), lens]), markers, told)

    @property
    def position(self) -> Array | None:
        if self.standing is None:
            return None
        return np.asarray(-so3_exp(self.standing[3:]).T @ self.standing[:3])

    def sees_from(self, board: Board, point: int) -> Array | None:
        del board, point
        return self.position


@dataclass(frozen=True, eq=False)
class ArmCamera(Camera):
    """On the tip, of boards in the world. The place begins with ``T_base_board`` of each board.

    It rides on the tip as a body does: three points, its centre and the ends of its x and y axes.
    """

    each: ClassVar[int] = CORNERS
    given_by: ClassVar[str] = "position_mm and rpy_deg of each board, and its own on the tip,"

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        before = [f"{board.name}." if len(self.boards) > 1 else "" for board in self.boards]
        standing = (u._replace(name=own + u.name) for own in before for u in FRAME)
        return (*standing, *self.of_lens)

    @property
    def parts(self) -> Mapping[str, slice]:
        ends = [MOTION.stop + SCALE.stop * k for k in range(len(self.boards) + 1)]
        boards = {
            f"board:{board.name}": slice(a, b)
            for board, a, b in zip(self.boards, ends, ends[1:], strict=False)
        }
        return {**super().parts, **boards}

    def sees_from(self, board: Board, point: int) -> Array | None:
        """A little before the board: what it lies on does not hide it."""
        if self.standing is None:
            return None
        place = self.standing.reshape(-1, 6)[self.boards.index(board)]
        lifted = board.points[point] - np.array([0.0, 0.0, _BEFORE if board.printed else 0.0])
        return np.asarray(so3_exp(place[3:]) @ lifted + place[:3])

    def sight(self, standing: Array, points: Array, loose: Array) -> Sight:
        corners = points[..., :1, :].reshape((*points.shape[:-2], 1, CORNERS, 3))  # all alike
        centre, axes = frame_of(corners)
        targets, *by = self._targets(standing, loose)
        ray = targets[..., None, :, :] - centre
        by_board, by_part = (axes @ own[..., None, :, :, :] for own in by)
        return Sight(rotate(axes, ray), by_corners(axes, ray), by_board, by_part)

    def _targets(self, standing: Array, loose: Array) -> tuple[Array, Array, Array]:
        """The boards' points (..., C, 3) in base axes.

        Their derivatives: (..., C, 3, 6 boards), and by what came loose of the boards
        """
        places = standing.reshape((*standing.shape[:-1], -1, 6))
        count = sum(len(board.points) for board in self.boards)
        points = np.zeros((*standing.shape[:-1], count, 3))
        by = np.zeros((*points.shape, standing.shape[-1]))
        by_loose = np.zeros((*points.shape, loose.shape[-1]))
        for k, board in enumerate(self.boards):
            shape, own = board.points, board.channels
            part = slice(SCALE.stop * k, SCALE.stop * (k + 1))
            if loose.shape[-1]:
                shape, by_part = displaced_shape(loose[..., part], shape)
            points[..., own, :], R, by_place = moved_as_one(places[..., k, :], shape)
            by[..., own, :, 6 * k : 6 * k + 6] = by_place
            if loose.shape[-1]:
                by_loose[..., own, :, part] = R @ by_part
        return points, by, by_loose

    def start(self, rows: Array, seen: Mask, arm: Nominal) -> Start:
        """Where the rays of all images meet the boards: the arm carries the camera, seen from it the
        base moves.
        """
        known = arm.placed
        guess = np.zeros(6 * len(self.boards)) if self.standing is None or known else self.standing
        bodies = tuple(
            Ridden(board.channels, board.points, so3_exp(place[3:]), place[:3], known)
            for board, place in zip(self.boards, guess.reshape(-1, 6), strict=True)
        )
        centre, axes = frame_of(arm.markers[:CORNERS])
        back, free = np.swapaxes(arm.R_tip, -1, -2), arm.free[:CORNERS].any()
        base, camera = (back, -rotate(back, arm.p_tip)), (axes, -axes @ centre)
        places, lens = self.resected(rows, seen, Mounted(base, bodies, camera, not free))
        corners = corners_of(places.R.T, -places.R.T @ places.t)
        corners = np.tile(corners, (len(arm.markers) // CORNERS, 1))
        stands = [twist_of(*place) for place in places.bodies]
        markers = np.where(arm.free, corners, arm.markers)
        return Start(np.concatenate([*stands, lens]), markers, arm.free)


Pixels = tuple[Positive, Positive]
Coefficients = tuple[Number, Number, Number, Number] | tuple[Number, Number, Number, Number, Number]
FreeParts = list[Literal["focal", "center", "distortion"]]


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

    def values(self) -> Array:
        """Those of the lens's values, shape (9,), NaN where none is given."""
        of_distortion = self.distortion if isinstance(self.distortion, list) else [self.distortion]
        of_distortion = [*of_distortion, *of_distortion[-1:] * 5][:5]
        std = [self.focal_px, self.focal_px, self.center_px, self.center_px, *of_distortion]
        return np.array(std, dtype=float)


class CameraTable(BodyTable, KeysTable):
    """A camera: its keys in a cell."""

    reads = "boards"
    makes = FixedCamera
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
    free: FreeParts = []
    """camera: parts of the lens that are identified"""
    intrinsics_std: Annotated[Array, Written(IntrinsicsStd, IntrinsicsStd.values)] | None = None
    """camera: standard deviations of the lens values"""
    tilt: Annotated[Positive, Field(lt=90), times(DEG), key("max_tilt_deg")] = 60.0 * DEG
    """camera: largest angle between the line of sight and a board's normal in a plan"""
    min_points: Count | None = None
    """camera: fewest points by which a plan counts a board, by default all of a chessboard, half of
    others"""

    def seen(self, boards: Mapping[str, BoardTable]) -> dict[str, BoardTable]:
        """The boards that it looks at: those that it names, else all that do not ride with it."""
        named = [*boards] if self.boards is None else self.boards
        return {n: boards[n] for n in named if n in boards and boards[n].on != self.on}

    def rides_before(self, boards: Mapping[str, BoardTable]) -> bool:
        """Whether it rides on a link and boards that it sees of these stand in the world."""
        return self.on != WORLD and any(own.on == WORLD for own in self.seen(boards).values())

    def instrument(self, name: str, cell: CellParts) -> Camera:
        """One of boards in the world, that it rides before, or of what rides elsewhere than itself."""
        every = {board: table for board, (table, *_) in cell.boards.items()}
        seen, carried = self.seen(every), self.rides_before(every)
        reads = [] if carried else [j for j, on in enumerate(cell.links) if on != self.on]
        boards: list[Board] = []
        targets: list[str] = []
        first = len(reads)
        for board, table in seen.items():
            _, names, points = cell.boards[board]
            channels = slice(first + len(targets), first + len(targets) + len(points))
            boards.append(table.board(board, channels, points, self.min_points))
            targets += names
            part = cell.parts[name if carried else board]
            reads += [*range(part.start, part.stop)] * (len(names) if carried else 1)
        believed = np.full(9, np.nan) if self.intrinsics_std is None else self.intrinsics_std
        free = np.isfinite(believed)
        for part_of_lens in self.free:
            free[FREE[part_of_lens]] = True
        return (ArmCamera if carried else FixedCamera)(
            name=name,
            markers=tuple(reads),
            targets=tuple(targets) if carried else (),
            lens=self.lens,
            sigma=self.sigma_px,
            image=None if self.image_px is None else np.array(self.image_px),
            free=np.flatnonzero(free),
            believed=believed,
            boards=tuple(boards),
            tilt=self.tilt,
            standing=self._standing([*seen.values()], carried),
        )

    @property
    def lens(self) -> Lens:
        """As the cell gives it."""
        focal = self.focal_px if isinstance(self.focal_px, tuple) else (self.focal_px,) * 2
        return Lens(np.array([*focal, *self.center_px, *(*self.distortion, 0.0)[:5]]))

    def _standing(self, boards: Sequence[BodyTable], carried: bool) -> Array | None:
        """The place of the camera, or of the boards before which it is carried, if given."""
        still = boards if carried else [self]
        if not all(body.stated for body in still):
            return None
        places = [body.frame if carried else inverse(body.frame) for body in still]
        return np.concatenate([twist_of(T[:3, :3], T[:3, 3]) for T in places])
