"""What other instruments read of an arm: rows of numbers, their noise, and how a cell describes them.

Each is at a place and reads something that sits on the tip; neither is known to the user. ``place``
and ``tip`` displace both, for derivatives.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from studies.research.truth.arms import Array

NAME = "eye"
_ZERO = -0.3  # m, what a wire shows less than its length
_DISTORTION = (-0.11, 0.06, 6e-4, -4e-4, 0.0)
_FOCAL, _CENTER, _PIXELS = 1500.0, np.array([1024.0, 768.0]), np.array([2048.0, 1536.0])
Sites = NDArray[np.int_]


@dataclass(frozen=True, eq=False)
class View:
    """The tip at N readings, and what is wrong with the instrument.

    R, p : ndarray, shapes (N, 3, 3) and (N, 3), m, tip in base axes
    site : ndarray of int, shape (N,), which of several places is touched
    larger : ndarray, shape (N,), share by which the focal length is larger; pitch : of the board
    apart : ndarray, shape (N, 6), m and rad, by which the instrument has moved, in its axes, of a
        socket along the base's; seat : ndarray, shape (N, 3), m, by which the ball has moved on the tip
    """

    R: Array
    p: Array
    site: Sites
    larger: Array
    pitch: float
    apart: Array
    seat: Array


def rotation(r: Array) -> Array:
    """Rotation matrices of vectors (.., 3)."""
    return np.asarray(Rotation.from_rotvec(r.reshape(-1, 3)).as_matrix().reshape((*r.shape, 3)))


@dataclass(frozen=True, eq=False)
class Reader(ABC):
    """An instrument.

    R, p : its frame in base axes, or in that of the tip where it rides on it
    R_on, p_on : the frame of what it reads on the tip, or in the base where it rides on the tip
    sigma : of each number, m or px
    places, tips : how many numbers of each are unknown; numbers : of a reading, on which noise falls
    """

    R: Array
    p: Array
    R_on: Array
    p_on: Array
    sigma: float
    places, tips, numbers = 6, 6, 3
    columns: ClassVar[tuple[str, ...]] = ()

    @abstractmethod
    def rows(self, view: View, place: Array, tip: Array) -> Array:
        """Readings (N, C, r), NaN where there is none."""

    @property
    def floor(self) -> float:
        """RMS of the noise as a diagnosis states it, mm or px."""
        return float(np.sqrt(self.numbers)) * self.sigma * 1e3

    @property
    @abstractmethod
    def cell(self) -> str:
        """Its tables in the cell."""

    @abstractmethod
    def row(self, row: Array, channel: int, site: int) -> tuple[str, str, list[str]]:
        """Instrument, marker and numbers of one reading in a table."""

    def off(self, a: Array, b: Array) -> Array:
        """``a - b`` in standard deviations, (N, C, ..)."""
        return np.asarray((a - b) / self.sigma)

    def noisy(self, rng: np.random.Generator, rows: Array) -> Array:
        """The same with noise."""
        return np.asarray(rows + rng.normal(scale=self.sigma, size=rows.shape))

    def frames(self, place: Array, tip: Array) -> tuple[Array, Array, Array, Array]:
        """Its frame and that of what it reads, both displaced."""
        return (
            self.R @ rotation(place[3:6]),
            self.p + self.R @ place[:3],
            self.R_on @ rotation(tip[3:6]),
            self.p_on + self.R_on @ tip[:3],
        )


@dataclass(frozen=True, eq=False)
class Camera(Reader):
    """Of a shape (C, 3) on the tip, or on the tip of one in the world."""

    shape: Array
    rides: bool
    columns = ("u_px", "v_px")

    def rows(self, view: View, place: Array, tip: Array) -> Array:
        R, p, R_on, p_on = self.frames(place, tip)
        first, other = ((R, p), (R_on, p_on)) if self.rides else ((R_on, p_on), (R, p))
        carried = view.R @ first[0], view.p + view.R @ first[1]
        fixed = other[0][None], other[1][None]
        eye, seen = (carried, fixed) if self.rides else (fixed, carried)
        R_eye = eye[0] @ rotation(view.apart[:, 3:])
        p_eye = eye[1] + (eye[0] @ view.apart[:, :3, None])[..., 0]
        points = self.shape * (1.0 + view.pitch) @ np.swapaxes(seen[0], -1, -2) + seen[1][:, None]
        ahead = (points - p_eye[:, None]) @ R_eye
        before = ahead[..., 2] > 0.2
        flat = ahead[..., :2] / np.where(before, ahead[..., 2], 1.0)[..., None]
        r2 = (flat**2).sum(axis=-1)
        pixels = _CENTER + _FOCAL * (1.0 + view.larger)[:, None, None] * _bent(flat, r2)
        inside = before & (r2 < 0.7) & ((pixels > 0.0) & (pixels < _PIXELS)).all(axis=-1)
        return np.asarray(np.where(inside[..., None], pixels, np.nan))

    @property
    def floor(self) -> float:
        return float(np.sqrt(2.0)) * self.sigma

    @property
    def cell(self) -> str:
        points = [f"p{k} = {(1e3 * s).round(6).tolist()}" for k, s in enumerate(self.shape)]
        there, here = ("world", "tip") if self.rides else ("tip", "world")
        return (
            f'[boards.plate]\non = "{there}"\npoints_mm = {{ {", ".join(points)} }}\n'
            f'[instruments.{NAME}]\nkind = "camera"\non = "{here}"\nfocal_px = {_FOCAL}\n'
            f"center_px = {_CENTER.tolist()}\ndistortion = {list(_DISTORTION)}\n"
            f"image_px = {_PIXELS.astype(int).tolist()}\nsigma_px = {self.sigma}\n"
        )

    def row(self, row: Array, channel: int, site: int) -> tuple[str, str, list[str]]:
        return NAME, f"plate:p{channel}", [f"{x:.5f}" for x in row]


def _bent(flat: Array, r2: Array) -> Array:
    """Where a lens puts points (.., 2) of its plane, by the usual polynomial."""
    k1, k2, p1, p2, k3 = _DISTORTION
    x, y = np.moveaxis(flat, -1, 0)
    radial = 1.0 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    across = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    down = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return np.stack([across, down], axis=-1)


@dataclass(frozen=True, eq=False)
class Bodies(Reader):
    """Motion capture of one body; turn : rad, as sigma of each coordinate of its rotation."""

    turn: float
    columns = ("x_mm", "y_mm", "z_mm", "qw", "qx", "qy", "qz")

    def rows(self, view: View, place: Array, tip: Array) -> Array:
        R, p, R_on, p_on = self.frames(place, tip)
        there = view.p + view.R @ p_on
        return _poses((there - p) @ R, Rotation.from_matrix(R.T @ view.R @ R_on))

    def off(self, a: Array, b: Array) -> Array:
        first, second = (Rotation.from_quat(np.roll(x[:, 0, 3:], -1, axis=-1)) for x in (a, b))
        turn = (second.inv() * first).as_rotvec() / self.turn
        shift = second.inv().apply(a[:, 0, :3] - b[:, 0, :3]) / self.sigma
        return np.concatenate([shift, turn], axis=-1)[:, None]

    def noisy(self, rng: np.random.Generator, rows: Array) -> Array:
        turned = Rotation.from_quat(np.roll(rows[:, 0, 3:], -1, axis=-1))
        turn = Rotation.from_rotvec(rng.normal(scale=self.turn, size=(len(rows), 3)))
        shift = turned.apply(rng.normal(scale=self.sigma, size=(len(rows), 3)))
        return _poses(rows[:, 0, :3] + shift, turned * turn)

    @property
    def cell(self) -> str:
        return (
            f'[bodies.flange]\n[instruments.{NAME}]\nkind = "pose"\n'
            f"sigma_mm = {self.sigma * 1e3:.6g}\nsigma_urad = {self.turn * 1e6:.6g}\n"
        )

    def row(self, row: Array, channel: int, site: int) -> tuple[str, str, list[str]]:
        return NAME, "flange", [f"{x:.9f}" for x in row * np.repeat([1e3, 1.0], [3, 4])]


def _poses(points: Array, turn: Rotation) -> Array:
    """Rows (N, 1, 7): place, and quaternion with w first."""
    return np.concatenate([points, np.roll(turn.as_quat(), 1, axis=-1)], axis=-1)[:, None]


@dataclass(frozen=True, eq=False)
class Touching(Reader, ABC):
    """Of one ball at ``p_on`` on the tip; its first guess is off by millimetres."""

    guess: Array
    tips = 3

    def ball(self, view: View, tip: Array) -> Array:
        """In base axes, (N, 3)."""
        return np.asarray(view.p + (view.R @ (self.p_on + tip + view.seat)[..., None])[..., 0])

    @property
    def marker(self) -> str:
        """The ball in the cell."""
        return f"[markers_mm]\nball = {(1e3 * self.guess).round(3).tolist()}\n"


@dataclass(frozen=True, eq=False)
class Wire(Touching):
    """A draw-wire from an unknown anchor, zeroed anywhere."""

    places, numbers = 4, 1
    columns = ("d_mm",)

    def rows(self, view: View, place: Array, tip: Array) -> Array:
        away = np.linalg.norm(self.ball(view, tip) - self.p - place[:3], axis=-1)
        return np.asarray(away + _ZERO + place[3])[:, None, None]

    @property
    def cell(self) -> str:
        keys = f'kind = "distance"\noffset = true\nsigma_mm = {self.sigma * 1e3:.6g}\n'
        return f"{self.marker}[instruments.{NAME}]\n{keys}"

    def row(self, row: Array, channel: int, site: int) -> tuple[str, str, list[str]]:
        return NAME, "ball", [f"{1e3 * row[0]:.6f}"]


@dataclass(frozen=True, eq=False)
class Nests(Touching):
    """Sockets (S, 3), m, in base axes: what is read is that the ball is in one of them."""

    centres: Array
    places = 12

    def rows(self, view: View, place: Array, tip: Array) -> Array:
        at = (self.centres + place.reshape(-1, 3))[view.site] + view.apart[:, :3]
        return np.asarray(self.ball(view, tip) - at)[:, None]

    @property
    def cell(self) -> str:
        keys = f'kind = "socket"\nsigma_mm = {self.sigma * 1e3:.6g}\n'
        nests = (f"[instruments.nest_{s}]\n{keys}" for s in range(len(self.centres)))
        return self.marker + "".join(nests)

    def row(self, row: Array, channel: int, site: int) -> tuple[str, str, list[str]]:
        return f"nest_{site}", "ball", []
