"""A camera's place, and what it sees on the tip, from the rays of many images together.

Each board in each image is posed by itself first. Of a plane the four and more points give a homography
(Zhang, PAMI 22(11), 2000), of a shape in space six and more give a projection matrix; both are linear
and are refined by the errors of the rays.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np

from calib.arm.se3 import cross, moved_as_one, nearest_rotation, rotate, so3_exp, so3_log
from calib.arrays import Array, IntArray, Mask
from calib.instruments.placing import Motions
from calib.instruments.protocol import Nominal
from calib.solver import levenberg_marquardt

Shape: TypeAlias = tuple[slice, Array]
"""Positions among the readings, and the points (n, 3), m, in the board's frame."""

_FLAT = 1e-3  # thickness over width: below, a board is a plane
_LEAST = {True: 4, False: 6}
_NEAR = 1e-3  # m

RESOLUTION = 1e-4
"""Standard deviation of the image coordinates x', y' that a search assumes."""


def board_poses(ideal: Array, seen: Mask, shapes: tuple[Shape, ...]) -> tuple[Motions, Mask]:
    """``T_camera_board`` of every board in every image, (m, B), and where there is enough of it.

    ideal : ndarray, shape (m, C, 2), undistorted ``X / Z`` and ``Y / Z``
    """
    m, count = len(ideal), len(shapes)
    R, t = np.tile(np.eye(3), (m, count, 1, 1)), np.zeros((m, count, 3))
    whole = np.zeros((m, count), dtype=bool)
    for k, (own, points) in enumerate(shapes):
        for here, images in _alike(seen[:, own]):
            found = _linearly(ideal[images, own][:, here], points[here])
            if found is not None:
                R[images, k], t[images, k], whole[images, k] = found
        if whole[:, k].any():
            good = whole[:, k]
            R[good, k], t[good, k] = refined(
                ideal[good, own], seen[good, own], points, R[good, k], t[good, k]
            )
    return (R, t), whole


def _alike(seen: Mask) -> Iterator[tuple[Mask, IntArray]]:
    """What is seen (C,), and the images (n,) in which it is that."""
    patterns, which = np.unique(seen, axis=0, return_inverse=True)
    for k, here in enumerate(patterns):
        yield here, np.flatnonzero(which.reshape(-1) == k)


def _linearly(ideal: Array, points: Array) -> tuple[Array, Array, Mask] | None:
    """A board's poses (n) by the linear way, and which are sound; None where too little is seen.

    ideal : ndarray, shape (n, C, 2); points : ndarray, shape (C, 3)
    """
    if len(points) < min(_LEAST.values()):
        return None
    middle = points.mean(axis=0)
    _, s, axes = np.linalg.svd(points - middle, full_matrices=False)
    flat = bool(s[2] < _FLAT * s[0])
    if len(points) < _LEAST[flat] or s[1] < _FLAT * s[0]:
        return None
    axes = axes * np.linalg.det(axes)
    local = (points - middle) @ axes.T / s[0]
    M = projection(ideal, local[:, :2] if flat else local)
    if flat:
        size = np.sqrt(np.linalg.norm(M[:, :, 0], axis=-1) * np.linalg.norm(M[:, :, 1], axis=-1))
        M = M / (size * _sign(M[:, 2, 2]))[:, None, None]
        x, y = M[:, :, 0], M[:, :, 1]
        R = nearest_rotation(np.stack([x, y, cross(x, y)], axis=-1))
    else:
        size = np.linalg.svd(M[:, :, :3], compute_uv=False).mean(axis=-1)
        M = M * (_sign(np.linalg.det(M[:, :, :3])) / size)[:, None, None]
        R = nearest_rotation(M[:, :, :3])
    t, R = M[:, :, -1] * s[0], R @ axes
    return R, t - R @ middle, np.isfinite(t).all(axis=-1) & (t[:, 2] > 0.0)


def _sign(a: Array) -> Array:
    return np.where(a < 0.0, -1.0, 1.0)


def projection(ideal: Array, points: Array) -> Array:
    """The matrices (..., 3, d + 1) with ``(x', y', 1) ~ M (p, 1)``, up to their factor.

    ideal : ndarray, shape (..., n, 2); points : ndarray, shape (n, d)
    """
    h = np.column_stack([points, np.ones(len(points))])
    width = h.shape[-1]
    A = np.zeros((*ideal.shape[:-1], 2, 3, width))
    A[..., 0, 0, :] = A[..., 1, 1, :] = h
    A[..., 2, :] = -ideal[..., None] * h[:, None]
    A = A.reshape((*ideal.shape[:-2], -1, 3 * width))
    Vt = np.linalg.svd(np.linalg.qr(A, mode="r"))[2]
    return np.asarray(Vt[..., -1, :].reshape((*ideal.shape[:-2], 3, width)))


def refined(ideal: Array, seen: Mask, points: Array, R: Array, t: Array) -> tuple[Array, Array]:
    """Poses (n) that fit the rays best, each image by itself."""
    weights = np.repeat(seen, 2, axis=-1) / RESOLUTION

    def linearise(values: Array) -> tuple[Array, Array]:
        seen_at, _, by_values = moved_as_one(values, points)
        predicted, by_point = rays_to(seen_at)
        J = by_point @ by_values
        r = (ideal - predicted).reshape((*values.shape[:-1], -1))
        return r * weights, J.reshape((*r.shape, 6)) * weights[..., None]

    start = np.concatenate([t, so3_log(R)], axis=-1)
    found = levenberg_marquardt(linearise, start, np.eye(6)).values
    return so3_exp(found[:, 3:]), found[:, :3]


def rays_to(points: Array) -> tuple[Array, Array]:
    """``X / Z, Y / Z`` of points (..., 3) in camera axes, and the derivatives (..., 2, 3)."""
    depth = np.maximum(points[..., 2], _NEAR)
    ray = points[..., :2] / depth[..., None]
    by = np.zeros((*points.shape[:-1], 2, 3))
    by[..., 0, 0] = by[..., 1, 1] = 1.0 / depth
    by[..., 2] = -ray / depth[..., None]
    return ray, by


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
        seen_at, R, by_place = moved_as_one(values[..., :6], points)
        predicted, by_point = rays_to(seen_at)
        J = by_point @ (R @ (self.R_tip @ by))
        J[..., :6] = by_point @ by_place
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
            u[..., here, :], _, J[..., here, :, part] = moved_as_one(values[..., part], local)
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
