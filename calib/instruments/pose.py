"""An instrument that reads whole poses: a 6-D tracker, motion capture, a board's pose by a camera.

A body stands on the tip as three points, its origin and the ends of its x and y axes, a metre long. A
row is the origin and these two axes in the frame of the instrument, so it is linear in the points; the
error is ``predicted^-1 measured``, of which a row's nine numbers hold the six of the tangent.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import ClassVar, Literal, Self

import numpy as np
from pydantic import model_validator

from calib.arm.se3 import moved_as_one, rotate, so3_log
from calib.arrays import Array, Mask
from calib.instruments.keys_table import CellParts, KeysTable
from calib.instruments.placing import hand_eye
from calib.instruments.protocol import MOTION, Component, Linear, Nominal, ReadingColumn, Start
from calib.instruments.riding import CORNERS, DIFFERENCES, frame_of, twist_of
from calib.instruments.tracker import Tracker
from calib.keys import MM, SMALLEST, URAD, Positive, Row
from calib.noise import Noise

_OFF_UNIT = 0.01  # that a quaternion's length may be off by, from rounding


@dataclass(frozen=True, eq=False)
class Pose(Tracker):
    """Frames of bodies in the frame of its station; place and stations as those of a tracker.

    covariance : ndarray, shape (6, 6), of an error (x, y, z, rx, ry, rz), m and rad, in the body's axes
    """

    covariance: Array = field(default_factory=lambda: np.eye(6))
    kind: ClassVar[str] = "pose"
    rows: ClassVar[int] = 9
    loose: ClassVar[slice | None] = MOTION
    each: ClassVar[int] = CORNERS
    columns: ClassVar[tuple[ReadingColumn, ...]] = (
        *(ReadingColumn(c, "length") for c in "xyz"),
        *(ReadingColumn(f"q{c}", "ratio") for c in "wxyz"),
    )
    numbers: ClassVar[tuple[Component, ...]] = (
        *(Component(c, "mm", 1e-3) for c in "xyz"),
        *(Component(f"r{c}", "mrad", 1e-3) for c in "xyz"),
    )

    def linearise(self, place: Array, points: Array) -> Linear:
        """Of the corners, as a tracker reads them; what came loose moves all that is read."""
        corners = points.reshape((*points.shape[:-2], -1, 3))
        rows, _, by_place = super().linearise(place[..., MOTION], corners)
        R = self.placement(place[..., MOTION])[0][..., None, None, :, :]
        if place.shape[-1] > MOTION.stop:
            rows, turn, by_motion = moved_as_one(place[..., None, MOTION.stop :], rows)
            R, by_place = turn @ R, np.concatenate([turn @ by_place, by_motion], axis=-1)
        corners = rows.reshape((*rows.shape[:-2], -1, CORNERS, 3))
        by_corner = by_place.reshape((*corners.shape, by_place.shape[-1]))
        frame = np.einsum("ab,...bi->...ai", DIFFERENCES, corners)
        turned = np.einsum("ab,...ij->...aibj", DIFFERENCES, R)
        by_frame = np.einsum("ab,...biu->...aiu", DIFFERENCES, by_corner)
        flat = (*frame.shape[:-2], 9)
        return Linear(
            frame.reshape(flat),
            turned.reshape((*turned.shape[:-4], 9, 9)),
            by_frame.reshape((*flat, by_place.shape[-1])),
        )

    def whitening(self, place: Array, rows: Array, sigma: Array) -> Array:
        """Six rows on the tangent at each reading, three of zeros.

        sigma : of a coordinate, m; all of the covariance scales with it
        """
        del place  # noise is stated in the axes of the body
        own = np.sqrt(np.trace(self.covariance[:3, :3]) / 3.0)
        factor = np.where(np.isnan(sigma), 1.0, own / sigma)
        half = np.linalg.inv(np.linalg.cholesky(self.covariance))
        W = np.zeros((*rows.shape, 9))
        W[..., :6, :] = factor[..., None, None] * (half @ _tangent(rotation_of(rows)))
        return W

    def shown(self, measured: Array, off: Array) -> Array:
        """``predicted^-1 measured``: its translation, and the logarithm of its rotation."""
        back = np.swapaxes(rotation_of(measured - off), -1, -2)
        turn = so3_log(back @ rotation_of(measured))
        return np.concatenate([rotate(back, off[..., :3]), turn], axis=-1)

    def row_of(self, entries: Array) -> Array:
        """From position and unit quaternion (w, x, y, z)."""
        length = np.linalg.norm(entries[..., 3:], axis=-1, keepdims=True)
        near = np.abs(length - 1.0) < _OFF_UNIT
        w, x, y, z = np.moveaxis(entries[..., 3:] / np.where(near, length, np.nan), -1, 0)
        e1 = [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)]
        e2 = [2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)]
        return np.concatenate([entries[..., :3], np.stack([*e1, *e2], axis=-1)], axis=-1)

    def entries_of(self, rows: Array) -> Array:
        r = so3_log(rotation_of(rows))
        half = np.linalg.norm(r, axis=-1, keepdims=True) / 2.0
        sine = r / 2.0 * np.sinc(half / np.pi)
        return np.concatenate([rows[..., :3], np.cos(half), sine], axis=-1)

    def bodies(self, markers: Array) -> Iterator[tuple[int, tuple[Array, Array]]]:
        """Of each body the position of its origin among markers (M, 3), and p and rotation vector."""
        for first in self.read_of(len(markers))[::CORNERS].tolist():
            origin, axes = frame_of(markers[first : first + CORNERS])
            yield first, (origin, so3_log(axes.T))

    @property
    def even(self) -> float | None:
        return None

    @property
    def fixed(self) -> bool:
        return False

    def start(self, rows: Array, seen: Mask, arm: Nominal) -> Start:
        """Place and bodies by hand-eye calibration of the nominal arm."""
        R, t, corners = hand_eye((rotation_of(rows), rows[..., :3]), seen, arm)
        told = arm.free & np.repeat(np.any(seen, axis=0), CORNERS)[:, None]
        return Start(twist_of(R, t), corners.reshape(-1, 3), told)


def rotation_of(rows: Array) -> Array:
    """R_station_body (..., 3, 3) of rows (..., 9)."""
    x, y = rows[..., 3:6], rows[..., 6:9]
    return np.stack([x, y, np.cross(x, y)], axis=-1)


def _tangent(R: Array) -> Array:
    """How small displacements in the axes of bodies R (..., 3, 3) follow rows, shape (..., 6, 9).

    The axes move by ``dx = R (w x e_x)`` and ``dy = R (w x e_y)``, hence ``w_x = z dy``,
    ``w_y = -z dx``, and w_z is half of ``y dx - x dy``.
    """
    x, y, z = np.moveaxis(R, -1, 0)
    T = np.zeros((*R.shape[:-2], 6, 9))
    T[..., :3, :3] = np.swapaxes(R, -1, -2)
    T[..., 3, 6:] = z
    T[..., 4, 3:6] = -z
    T[..., 5, 3:6], T[..., 5, 6:] = y / 2.0, -x / 2.0
    return T


_SYMMETRIC = 1e-6  # of the deviations
_UNITS = np.repeat([MM, URAD], 3)


class PoseTable(KeysTable):
    """What reads poses of bodies: its keys in a cell."""

    reads = "bodies"
    makes = Pose
    kind: Literal["pose"]
    sigma_mm: Positive | None = None
    """one standard deviation of a length"""
    sigma_urad: Positive | None = None
    """pose: one standard deviation of an angle"""
    covariance: tuple[Row, Row, Row, Row, Row, Row] | None = None
    """pose: replaces both sigmas, 6 x 6, mm and urad, body axes"""

    @model_validator(mode="after")
    def _one_noise(self) -> Self:
        stated = (self.sigma_mm is not None, self.sigma_urad is not None)
        if self.covariance is None and not all(stated):
            raise ValueError("needs its noise, sigma_mm and sigma_urad, or covariance")
        if self.covariance is not None:
            if any(stated):
                raise ValueError("has both sigma and covariance; keep one of them")
            _refuse_no_covariance(np.array(self.covariance))
        return self

    def instrument(self, name: str, cell: CellParts) -> Pose:
        parts = [cell.parts[body] for body, on in cell.read_as_poses.items() if on != self.on]
        if self.covariance is not None:
            covariance = np.array(self.covariance) * np.outer(_UNITS, _UNITS)
        else:
            sigma = np.repeat([self.sigma_mm or np.nan, self.sigma_urad or np.nan], 3)
            covariance = np.diag((sigma * _UNITS) ** 2)
        return Pose(
            name=name,
            markers=tuple(i for own in parts for i in range(own.start, own.stop)),
            noise=Noise.isotropic(float(np.sqrt(np.trace(covariance[:3, :3]) / 3.0))),
            covariance=covariance,
        )


def _refuse_no_covariance(C: Array) -> None:
    size = np.sqrt(np.maximum(np.diag(C), 0.0))
    if not (size > 0.0).all():
        raise ValueError("covariance needs variances above zero on its diagonal")
    scaled = C / np.outer(size, size)
    if np.abs(scaled - scaled.T).max() > _SYMMETRIC:
        raise ValueError("covariance is not symmetric")
    if np.linalg.eigvalsh(scaled)[0] < SMALLEST:
        raise ValueError("covariance is not positive definite")
