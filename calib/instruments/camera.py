"""A camera: pixels of points on the tip, seen from the world, or of a board, seen from the tip."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar, Self

import numpy as np

from calib.arm.se3 import (
    displaced_shape,
    moved_as_one,
    rotate,
    so3_exp,
    so3_log,
)
from calib.arrays import Array, IntArray, Mask
from calib.instruments.detection import Board
from calib.instruments.lens import CENTER, DISTORTION, FOCAL, Lens
from calib.instruments.points import Tracker
from calib.instruments.protocol import (
    MOTION,
    SCALE,
    Instrument,
    Linear,
    Nominal,
    Number,
    ReadingColumn,
    Start,
    Unknown,
)
from calib.instruments.resection import Mounted, Ridden, on_tip, resected
from calib.instruments.riding import CORNERS, by_corners, corners_of, frame_of

_BEFORE = 2e-3  # m
_BENT = 0.1  # plausible size of a coefficient of distortion
_OFF = 0.02  # of the focal length: plausible error of it and of the centre
FREE = {"focal": FOCAL, "center": CENTER, "distortion": DISTORTION}
"""Parts of a lens that may be unknown, by their names in a cell."""


@dataclass(frozen=True, eq=False)
class Camera(Instrument):
    """A pinhole with its lens. The place ends with what is unknown of the lens, beyond the given.

    sigma : float, px, of a coordinate; image : ndarray, shape (2,), px, its size, or None
    free : ndarray of int, positions of the unknown values of the lens
    believed : ndarray, shape (n,), standard deviations of the lens's values, NaN where none is given
    boards : tuple of Board, that it sees; tilt : rad, by which one that is seen leans at most
    standing : ndarray, shape (6,) or (6 boards,), where it, or they stand as far as is known, or None
    """

    lens: Lens = field(default_factory=Lens)
    sigma: float = 1.0
    image: Array | None = None
    free: IntArray = field(default_factory=lambda: np.zeros(0, dtype=int))
    believed: Array = field(default_factory=lambda: np.full(9, np.nan))
    boards: tuple[Board, ...] = ()
    standing: Array | None = None
    tilt: float = float(np.radians(60.0))
    kind: ClassVar[str] = "camera"
    rows: ClassVar[int] = 2
    columns: ClassVar[tuple[ReadingColumn, ...]] = (
        ReadingColumn("u", "pixel"),
        ReadingColumn("v", "pixel"),
    )

    @property
    def of_lens(self) -> tuple[Unknown, ...]:
        """What is unknown of the lens."""
        focal = float(self.lens.values[FOCAL].mean())
        return tuple(
            Unknown(self.lens.names[i], "px", 1.0, _OFF * focal) if i < DISTORTION.start
            else Unknown(self.lens.names[i], "", 1.0, _BENT)
            for i in self.free.tolist()
        )  # fmt: skip

    @property
    def guess(self) -> Array:
        found = np.zeros(len(self.unknowns))
        if self.standing is not None:
            found[: len(self.standing)] = self.standing
        return found

    @property
    def prior(self) -> Array:
        standing = len(self.unknowns) - len(self.free)
        return np.concatenate([np.full(standing, np.nan), self.believed[self.free]])

    @property
    def parts(self) -> Mapping[str, slice]:
        return {f"camera:{self.name}": MOTION}

    @property
    def metric(self) -> bool:
        return bool(self.boards)

    @property
    def numbers(self) -> tuple[Number, ...]:
        return (Number("u", "px", 1.0), Number("v", "px", 1.0))

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
    def viewed(self, points: Array) -> Array | None:
        """What points (m, C, 3 k), m, base axes, that readings take, show: (m, C, 3), camera axes.

        None where nobody said where it, or its boards, stand.
        """

    @abstractmethod
    def sees_from(self, board: Board, point: int) -> Array | None:
        """The end (3,) in the world, m, base axes, of the line of sight to a point of a board.

        None where it is not known. The other end is on the arm.
        """

    def found(self, points: Array) -> Mask:
        """Which of the readings (m, C) count, of points (m, C, 3 k), m, base axes."""
        viewed = self.viewed(points)
        if viewed is None:
            return np.ones(points.shape[:-1], dtype=bool)
        seen = np.asarray(viewed[..., 2] > 0.0)
        if self.image is not None:
            pixels = self.lens.project(viewed)
            seen &= ((pixels >= 0.0) & (pixels <= self.image)).all(axis=-1)
        for board in self.boards:
            own = (slice(None), board.channels)
            seen[own] = board.found(viewed[own], seen[own], self.tilt)
        return seen

    @property
    def _focal_free(self) -> bool:
        return bool(np.isin(np.arange(FOCAL.stop), self.free).all())

    def _lens_at(self, focal: float) -> Array:
        """What is unknown of the lens, with focal lengths of so many times their given values."""
        by = np.zeros(len(self.lens.values))
        by[FOCAL] = (focal - 1.0) * self.lens.values[FOCAL]
        return by[self.free]

    def _split(self, place: Array) -> tuple[Array, Lens, Array]:
        """Where the camera, or its boards, stand; the lens; and what came loose."""
        count = len(self.unknowns)
        standing = count - len(self.free)
        if not len(self.free):
            return place[..., :standing], self.lens, place[..., count:]
        by = np.zeros((*place.shape[:-1], len(self.lens.values)))
        by[..., self.free] = place[..., standing:count]
        return place[..., :standing], self.lens.moved(by), place[..., count:]


def _viewed(points: Array, loose: Array) -> tuple[Array, Array, Array]:
    """Points (..., m, C, 3) in the axes of a camera that moved: what it sees moves as one.

    Returns them and their derivatives by the points and by the motion, of which there may be none.
    """
    if not loose.shape[-1]:
        return points, np.eye(3), np.zeros((*points.shape, 0))
    return moved_as_one(loose[..., None, MOTION], points)


@dataclass(frozen=True, eq=False)
class FixedCamera(Camera):
    """In the world, of markers and boards on the tip. The place begins with ``T_camera_base``."""

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        return (*Tracker.unknowns, *self.of_lens)

    def linearise(self, place: Array, points: Array) -> Linear:
        standing, lens, loose = self._split(place)
        own, R, by_standing = moved_as_one(standing[..., None, :], points)
        viewed, turned, by_motion = _viewed(own, loose)
        rows, by_viewed, by_lens = lens.linearise(viewed)
        by_own = by_viewed @ turned if loose.shape[-1] else by_viewed
        by_place = np.concatenate(
            [by_own @ by_standing, by_lens[..., self.free], by_viewed @ by_motion], axis=-1
        )
        return Linear(rows, by_own @ R, by_place)

    def start(self, rows: Array, seen: Mask, arm: Nominal) -> Start:
        """Where the rays of all images meet what rides on the tip."""
        shapes = tuple((board.channels, board.points) for board in self.boards)
        bodies = on_tip(arm, shapes)
        guess = np.zeros(6) if self.standing is None or arm.placed else self.standing
        camera = so3_exp(guess[3:]), guess[:3]
        mounted = Mounted((arm.R_tip, arm.p_tip), bodies, camera, arm.placed)
        found = resected(self.lens.ideal(rows), seen, mounted, self._focal_free)
        markers, told = arm.markers.copy(), np.zeros_like(arm.free)
        for body, (R, t) in zip(bodies, found.bodies, strict=True):
            own = body.channels
            if not body.known and seen[:, own].any():
                markers[own], told[own] = body.points @ R.T + t, arm.free[own]
        place = np.concatenate([found.t, so3_log(found.R), self._lens_at(found.focal)])
        return Start(place, markers, told)

    @property
    def unforeseen(self) -> str:
        return (
            ""
            if self.standing is not None
            else "where it stands is not known; give its position_mm and rpy_deg in the base's frame, "
            "z ahead and x to the right of the image"
        )

    @property
    def position(self) -> Array | None:
        if self.standing is None:
            return None
        return np.asarray(-so3_exp(self.standing[3:]).T @ self.standing[:3])

    def sees_from(self, board: Board, point: int) -> Array | None:
        del board, point
        return self.position

    def viewed(self, points: Array) -> Array | None:
        if self.standing is None:
            return None
        return rotate(so3_exp(self.standing[3:]), points) + self.standing[:3]


@dataclass(frozen=True, eq=False)
class ArmCamera(Camera):
    """On the tip, of boards in the world. The place begins with ``T_base_board`` of each board.

    It rides on the tip as a body does: three points, its centre and the ends of its x and y axes.
    """

    each: ClassVar[int] = CORNERS

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        several = len(self.boards) > 1
        standing = (
            u._replace(name=f"{board.name}.{u.name}" if several else u.name)
            for board in self.boards
            for u in Tracker.unknowns
        )
        return (*standing, *self.of_lens)

    @property
    def parts(self) -> Mapping[str, slice]:
        ends = MOTION.stop + SCALE.stop * np.arange(len(self.boards) + 1)
        boards = {
            f"board:{board.name}": slice(int(a), int(b))
            for board, a, b in zip(self.boards, ends, ends[1:], strict=False)
        }
        return {**super().parts, **boards}

    @property
    def unforeseen(self) -> str:
        return (
            ""
            if self.standing is not None
            else "where its boards stand is not known; give position_mm and rpy_deg of each in the "
            "base's frame, and of the camera on the tip"
        )

    def viewed(self, points: Array) -> Array | None:
        if self.standing is None:
            return None
        centre, axes = self._seen_at(points)
        targets, _, _ = self._targets(self.standing, np.zeros(0))
        return rotate(axes, targets - centre)

    def sees_from(self, board: Board, point: int) -> Array | None:
        """A little before the board: what it lies on does not hide it."""
        if self.standing is None:
            return None
        place = self.standing.reshape(-1, 6)[self.boards.index(board)]
        lifted = board.points[point] - np.array([0.0, 0.0, _BEFORE if board.printed else 0.0])
        return np.asarray(so3_exp(place[3:]) @ lifted + place[:3])

    def _seen_at(self, points: Array) -> tuple[Array, Array]:
        """Its centre (..., 1, 3) and axes (..., 1, 3, 3), by rows, of points (..., C, 9), all alike."""
        return frame_of(points[..., :1, :].reshape((*points.shape[:-2], 1, CORNERS, 3)))

    def _targets(self, standing: Array, loose: Array) -> tuple[Array, Array, Array]:
        """The boards' points (..., C, 3) in base axes.

        Their derivatives: (..., C, 3, 6 boards), and by what came loose of the boards
        """
        batch, places = standing.shape[:-1], standing.reshape((*standing.shape[:-1], -1, 6))
        count = sum(len(board.points) for board in self.boards)
        points, by = np.zeros((*batch, count, 3)), np.zeros((*batch, count, 3, standing.shape[-1]))
        by_loose = np.zeros((*batch, count, 3, loose.shape[-1]))
        for k, board in enumerate(self.boards):
            shape = board.points
            part = slice(SCALE.stop * k, SCALE.stop * (k + 1))
            if loose.shape[-1]:
                shape, by_part = displaced_shape(loose[..., part], shape)
            moved, R, by_place = moved_as_one(places[..., k, :], shape)
            points[..., board.channels, :] = moved
            by[..., board.channels, :, 6 * k : 6 * k + 6] = by_place
            if loose.shape[-1]:
                by_loose[..., board.channels, :, part] = R @ by_part
        return points, by, by_loose

    def linearise(self, place: Array, points: Array) -> Linear:
        standing, lens, loose = self._split(place)
        centre, axes = self._seen_at(points)
        targets, by_board, by_part = self._targets(standing, loose[..., MOTION.stop :])
        ray = targets[..., None, :, :] - centre
        viewed, turned, by_motion = _viewed(rotate(axes, ray), loose)
        rows, by_viewed, by_lens = lens.linearise(viewed)
        by_own = by_viewed @ turned if loose.shape[-1] else by_viewed
        by_target = by_own @ axes
        parts = [
            by_target @ by_board[..., None, :, :, :],
            by_lens[..., self.free],
            by_viewed @ by_motion,
            by_target @ by_part[..., None, :, :, :],
        ]
        return Linear(rows, by_own @ by_corners(axes, ray), np.concatenate(parts, axis=-1))

    def start(self, rows: Array, seen: Mask, arm: Nominal) -> Start:
        """Where the rays of all images meet the boards: the arm carries the camera, seen from it the
        base moves.
        """
        known = arm.placed
        guess = np.zeros(6 * len(self.boards)) if self.standing is None or known else self.standing
        bodies = tuple(
            Ridden(board.channels, board.points, so3_exp(own[3:]), own[:3], known)
            for board, own in zip(self.boards, guess.reshape(-1, 6), strict=True)
        )
        centre, axes = frame_of(arm.markers[:CORNERS])
        back = np.swapaxes(arm.R_tip, -1, -2)
        mounted = Mounted(
            (back, -rotate(back, arm.p_tip)),
            bodies,
            (axes, -axes @ centre),
            not arm.free[:CORNERS].any(),
        )
        found = resected(self.lens.ideal(rows), seen, mounted, self._focal_free)
        places = np.concatenate([np.concatenate([t, so3_log(R)]) for R, t in found.bodies])
        corners = corners_of(found.R.T, -found.R.T @ found.t)
        markers = np.where(
            arm.free, np.tile(corners, (len(arm.markers) // CORNERS, 1)), arm.markers
        )
        place = np.concatenate([places, self._lens_at(found.focal)])
        return Start(place, markers, arm.free)
