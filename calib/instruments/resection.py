"""A camera's place, and what it sees on the tip, from the rays of many images together."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from calib.arm.se3 import nearest_rotation, rotate, skew, so3_exp, so3_log, so3_right_jacobian
from calib.arrays import Array, IntArray, Mask
from calib.instruments.protocol import Nominal
from calib.instruments.seen_boards import RESOLUTION, Shape, projection, rays_to
from calib.solver import levenberg_marquardt

_STARTS = 48
_FOLLOWED = 8  # the best of them
_SEARCHED = 240  # readings that a search looks at: more tell it nothing new


class Seen(NamedTuple):
    """Where a camera sees the base, ``R`` (3, 3) and ``t`` (3,), m, and what is on the tip.

    frames : ndarray, shape (B, 3, 3), of the boards: origin and two axes by rows
    """

    R: Array
    t: Array
    frames: Array


def resected(
    ideal: Array, seen: Mask, arm: Nominal, shapes: tuple[Shape, ...], first: Seen | None
) -> tuple[Array, Array, Array]:
    """``R``, ``t`` of a camera's base, and the markers on the tip, until the rays of all images fit.

    first : where a hand-eye calibration has them. Without it the tip itself is taken for every point,
        which gives a projection matrix; then boards are turned any way about it, markers stand on it,
        and all move together.
    """
    images = _images(ideal, seen, arm, shapes)
    starts = images.anyhow(arm.placed) if first is None else images.at(first)
    cost = np.sum(images.linearise(starts)[0] ** 2, axis=-1)
    best = starts[np.argsort(cost)[:_FOLLOWED]]
    found = levenberg_marquardt(images.linearise, best, np.eye(images.size)[:, 6 * arm.placed :])
    values = found.values[int(np.argmin(found.cost))]
    markers = arm.markers.copy()
    for part, own, points in images.boards:
        markers[own] = points @ so3_exp(values[part][3:]).T + values[part][:3]
    for part, j in images.singles:
        markers[j] += values[part]
    return so3_exp(values[3:6]), values[:3], markers


@dataclass(frozen=True, eq=False)
class _Images:
    """Readings n by the values (p,): the camera's place, then a place of each board, then markers.

    rays : ndarray, shape (n, 2); R_tip, p_tip : of their poses; channel : ndarray of int, shape (n,)
    markers : ndarray, shape (C, 3), m, guesses in the tip frame
    boards : part of the values, channels and points of each board whose place is unknown; numbers : of
        each, its place among all boards
    singles : part of the values and channel of each marker that is
    """

    rays: Array
    R_tip: Array
    p_tip: Array
    channel: IntArray
    markers: Array
    boards: tuple[tuple[slice, slice, Array], ...]
    numbers: tuple[int, ...]
    singles: tuple[tuple[slice, int], ...]

    @property
    def size(self) -> int:
        """How many values there are."""
        return 6 + 6 * len(self.boards) + 3 * len(self.singles)

    def linearise(self, values: Array) -> tuple[Array, Array]:
        """Residuals (..., 2 n) of the rays, and their derivatives (..., 2 n, p)."""
        u, by = self._on_tip(values)
        points = self.p_tip + rotate(self.R_tip, u)
        R = so3_exp(values[..., 3:6])[..., None, :, :]
        predicted, by_point = rays_to(rotate(R, points) + values[..., None, :3])
        J = by_point @ (R @ (self.R_tip @ by))
        turn = -R @ skew(points) @ so3_right_jacobian(values[..., 3:6])[..., None, :, :]
        J[..., :3], J[..., 3:6] = by_point, by_point @ turn
        r = (self.rays - predicted).reshape((*values.shape[:-1], -1))
        return r / RESOLUTION, J.reshape((*r.shape, self.size)) / RESOLUTION

    def _on_tip(self, values: Array) -> tuple[Array, Array]:
        """Where the points read are on the tip (..., n, 3), and the derivatives (..., n, 3, p)."""
        u = np.broadcast_to(
            self.markers[self.channel], (*values.shape[:-1], *self.p_tip.shape)
        ).copy()
        J = np.zeros((*u.shape, self.size))
        for part, own, points in self.boards:
            here = (self.channel >= own.start) & (self.channel < own.stop)
            local = points[self.channel[here] - own.start]
            R = so3_exp(values[..., part][..., 3:])[..., None, :, :]
            turn = so3_right_jacobian(values[..., part][..., 3:])[..., None, :, :]
            u[..., here, :] = rotate(R, local) + values[..., part][..., None, :3]
            J[..., here, :, part.start : part.start + 3] = np.eye(3)
            J[..., here, :, part.start + 3 : part.stop] = -R @ skew(local) @ turn
        for part, j in self.singles:
            here = self.channel == j
            u[..., here, :] = self.markers[j] + values[..., None, part]
            J[..., here, :, part] = np.eye(3)
        return u, J

    def at(self, first: Seen) -> Array:
        """The values (1, p) of a hand-eye calibration."""
        start = np.zeros((1, self.size))
        start[0, :6] = [*first.t, *so3_log(first.R)]
        for (part, _, _), b in zip(self.boards, self.numbers, strict=True):
            origin, x, y = first.frames[b]
            start[0, part] = [*origin, *so3_log(np.stack([x, y, np.cross(x, y)], axis=-1))]
        return start

    def anyhow(self, placed: bool) -> Array:
        """Values with every board on the tip, turned at random; one where there is none."""
        drawn = nearest_rotation(np.random.default_rng(0).normal(size=(_STARTS, 3, 3)))
        starts = np.zeros((_STARTS if self.boards else 1, self.size))
        for k, (part, _, _) in enumerate(self.boards):
            starts[:, part.start + 3 : part.stop] = so3_log(np.roll(drawn, k, axis=0))
        if not placed:
            points = self.p_tip + rotate(self.R_tip, self.markers[self.channel])
            starts[:, :6] = _of_tip(self.rays, points)
        return starts


def _images(ideal: Array, seen: Mask, arm: Nominal, shapes: tuple[Shape, ...]) -> _Images:
    pose, channel = np.nonzero(seen)
    if len(pose) > _SEARCHED:
        chosen = np.unique(np.linspace(0, len(pose) - 1, _SEARCHED).astype(int))
        pose, channel = pose[chosen], channel[chosen]
    unknown = [k for k, (own, _) in enumerate(shapes) if arm.free[own].any()]
    boards = tuple(
        (slice(6 + 6 * i, 12 + 6 * i), *shapes[k]) for i, k in enumerate(unknown)
    )  # fmt: skip
    on_boards = {c for own, _ in shapes for c in range(own.start, own.stop)}
    free = [j for j in np.unique(channel).tolist() if j not in on_boards and arm.free[j].any()]
    first = 6 + 6 * len(boards)
    singles = tuple((slice(first + 3 * i, first + 3 * i + 3), j) for i, j in enumerate(free))
    return _Images(
        ideal[pose, channel], arm.R_tip[pose], arm.p_tip[pose], channel, arm.markers, boards,
        tuple(unknown), singles,
    )  # fmt: skip


def _of_tip(rays: Array, points: Array) -> Array:
    """A camera's place (6,) from points (n, 3), m, in base axes that are known but roughly."""
    middle = points.mean(axis=0)
    size = float(np.sqrt(np.mean((points - middle) ** 2)))
    M = projection(rays, (points - middle) / size)
    ahead = float(np.mean((points - middle) @ M[2, :3] / size + M[2, 3]))
    M = M * (np.sign(ahead) or 1.0)  # what is seen lies before the camera
    R = nearest_rotation(M[:, :3])
    t = M[:, 3] * size / np.linalg.svd(M[:, :3], compute_uv=False).mean()
    return np.concatenate([t - R @ middle, so3_log(R)])
