"""A camera's place, and those of the bodies that it sees, from the rays of many images together.

The arm moves a camera before bodies, or bodies before a camera: ``x ~ T_camera A_i T_body p`` with A_i
the arm at image i, from the tip to the base or back. A search follows the best of several starts: what
the cell says; hand-eye calibration by the poses of each body in each image (OpenCV's ``solvePnP``); and
bodies turned and shifted at random about where they ride, which makes all their points one shape that
the camera sees at once.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from calib.arm.se3 import fit_rigid, moved_as_one, nearest_rotation, rotate, so3_exp, so3_log
from calib.arrays import Array, IntArray, Mask
from calib.instruments.placing import Motions, hand_eye
from calib.instruments.protocol import Nominal
from calib.instruments.riding import CORNERS, corners_of, frame_of, twist_of
from calib.solver import levenberg_marquardt

_RESOLUTION = 1e-4  # standard deviation of X / Z and Y / Z that a search assumes
_NEAR = 1e-3  # m
_LEAST = 4  # points that give a pose
_LINE, _PLANE = 1e-3, 0.02  # width, thickness over length: below, points lie on a line, on a plane
_ENOUGH = 3  # images of a body that fix it beside the camera
_POSED = 60  # images of a body that are looked at by themselves
_DRAWN = 32  # places of bodies
_ABOUT = 0.3  # of the extent of the arm's motion: how far from it a body rides
_FOLLOWED = 8  # starts, the best of them
_SEARCHED = 240  # readings that a search looks at: more add nothing
_CAMERA, _FOCAL = slice(0, 6), 6


class Ridden(NamedTuple):
    """A body that a camera sees: its readings, points (n, 3), m, and its place, known or guessed."""

    channels: slice
    points: Array
    R: Array
    t: Array
    known: bool


class Mounted(NamedTuple):
    """What the arm carries, at m images, and what is known of places.

    arm : rotations (m, 3, 3) and translations (m, 3), m, from what carries to where the camera sees the
        base; camera : where it sees that base; known : whether that is so, or a guess
    """

    arm: Motions
    bodies: tuple[Ridden, ...]
    camera: Motions
    known: bool


class Resected(NamedTuple):
    """Places of the base in the camera's frame and of every body; and the focal length's factor."""

    R: Array
    t: Array
    bodies: list[Motions]
    focal: float


def on_tip(arm: Nominal, shapes: tuple[tuple[slice, Array], ...]) -> tuple[Ridden, ...]:
    """The boards and then the markers of the tip, as bodies.

    shapes : of each board its positions among the readings, and points (n, 3), m, in its frame
    """
    bodies, free = list[Ridden](), np.asarray(arm.free.any(axis=1))
    for channels, points in shapes:
        T = fit_rigid(arm.markers[channels], points)
        bodies.append(Ridden(channels, points, T[:3, :3], T[:3, 3], not free[channels].any()))
    taken = {c for channels, _ in shapes for c in range(channels.start, channels.stop)}
    for j in sorted(set(range(len(arm.markers))) - taken):
        channels = slice(j, j + 1)
        bodies.append(Ridden(channels, np.zeros((1, 3)), np.eye(3), arm.markers[j], not free[j]))
    return tuple(bodies)


def resected(ideal: Array, seen: Mask, mounted: Mounted, focal: bool = False) -> Resected:
    """The places from which the rays of all images fit.

    ideal : ndarray, shape (m, C, 2), undistorted ``X / Z`` and ``Y / Z``
    focal : whether rays have one factor in common that is unknown
    """
    images = _images(ideal, seen, mounted, focal)
    guessed = images.at(mounted.camera, [(body.R, body.t) for body in mounted.bodies])
    starts = [guessed[None], *_by_hand_eye(ideal, seen, mounted, images)]
    start = np.concatenate([*starts, *images.drawn(guessed, mounted.known)])
    cost = np.sum(images.linearise(start)[0] ** 2, axis=-1)
    best = start[np.argsort(np.nan_to_num(cost, nan=np.inf))[:_FOLLOWED]]
    minimum = levenberg_marquardt(images.linearise, best, images.span)
    values = minimum.values[int(np.argmin(minimum.cost))]
    places = [(so3_exp(values[part][3:]), values[part][:3]) for part in images.parts]
    return Resected(so3_exp(values[3:6]), values[:3], places, float(values[_FOCAL]))


# -- all images at once --------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Images:
    """Readings n by the values (p,): the camera's place, a factor of the rays, the bodies' places.

    rays : ndarray, shape (n, 2); R_arm, p_arm : of their images; channel : ndarray of int, shape (n,)
    bodies : tuple of Ridden; span : ndarray, shape (p, k), what is unknown of the values
    """

    rays: Array
    R_arm: Array
    p_arm: Array
    channel: IntArray
    bodies: tuple[Ridden, ...]
    span: Array

    @property
    def parts(self) -> list[slice]:
        """Where each body's place stands among the values."""
        return [slice(7 + 6 * k, 13 + 6 * k) for k in range(len(self.bodies))]

    def linearise(self, values: Array) -> tuple[Array, Array]:
        """Residuals (..., 2 n) of the rays, and their derivatives (..., 2 n, p)."""
        u, by = self._ridden(values)
        points = self.p_arm + rotate(self.R_arm, u)
        viewed, R, by_place = moved_as_one(values[..., _CAMERA], points)
        rays, by_point = _rays_to(viewed)
        J = by_point @ (R @ (self.R_arm @ by))
        J[..., _CAMERA] = by_point @ by_place
        factor = values[..., None, None, _FOCAL]
        J = J * factor[..., None]
        J[..., _FOCAL] = rays
        r = (self.rays - factor * rays).reshape((*values.shape[:-1], -1))
        return r / _RESOLUTION, J.reshape((*r.shape, len(self.span))) / _RESOLUTION

    def _ridden(self, values: Array) -> tuple[Array, Array]:
        """Where the points read ride on the arm (..., n, 3), and the derivatives (..., n, 3, p)."""
        u = np.zeros((*values.shape[:-1], *self.p_arm.shape))
        J = np.zeros((*u.shape, len(self.span)))
        for body, part in zip(self.bodies, self.parts, strict=True):
            channels = body.channels
            here = (self.channel >= channels.start) & (self.channel < channels.stop)
            local = body.points[self.channel[here] - channels.start]
            u[..., here, :], _, J[..., here, :, part] = moved_as_one(values[..., part], local)
        return u, J

    def at(self, camera: Motions, places: list[Motions]) -> Array:
        """The values (p,) of places."""
        each = [twist_of(R, t) for R, t in (camera, *places)]
        return np.concatenate([each[0], [1.0], *each[1:]])

    def drawn(self, guessed: Array, known: bool) -> Iterator[Array]:
        """Values (k, p) with the unknown bodies drawn about where they are guessed.

        known : whether the camera's place is
        """
        unknown = [k for k, body in enumerate(self.bodies) if not body.known]
        rng, count = np.random.default_rng(0), _DRAWN if unknown else 1
        extent = float(np.sqrt(self.p_arm.var(axis=0).sum()))
        start = np.tile(guessed, (count, 1))
        for k in unknown:
            part = self.parts[k]
            if len(self.bodies[k].points) > 1:
                start[:, part][:, 3:] = so3_log(nearest_rotation(rng.normal(size=(count, 3, 3))))
            start[1:, part][:, :3] += rng.normal(scale=_ABOUT * extent, size=(count - 1, 3))
        if known:
            yield start
            return
        points = self.p_arm + rotate(self.R_arm, self._ridden(start)[0])
        for own, there in zip(start, points, strict=True):
            for R, t, _ in poses_of(self.rays, there):
                yield np.concatenate([twist_of(R, t), own[_FOCAL:]])[None]


def _images(ideal: Array, seen: Mask, mounted: Mounted, focal: bool) -> _Images:
    pose, channel = np.nonzero(seen)
    if len(pose) > _SEARCHED:
        chosen = np.unique(np.linspace(0, len(pose) - 1, _SEARCHED).astype(int))
        pose, channel = pose[chosen], channel[chosen]
    free = [*[not mounted.known] * 6, focal]
    for body in mounted.bodies:
        moves = bool(seen[:, body.channels].any()) and not body.known
        free += [*[moves] * 3, *[moves and len(body.points) > 1] * 3]
    (R, p), span = mounted.arm, np.eye(len(free))[:, np.array(free)]
    return _Images(ideal[pose, channel], R[pose], p[pose], channel, mounted.bodies, span)


def _rays_to(points: Array) -> tuple[Array, Array]:
    """``X / Z, Y / Z`` of points (..., 3) in camera axes, and the derivatives (..., 2, 3)."""
    depth = np.maximum(points[..., 2], _NEAR)
    ray = points[..., :2] / depth[..., None]
    by = np.zeros((*points.shape[:-1], 2, 3))
    by[..., 0, 0] = by[..., 1, 1] = 1.0 / depth
    by[..., 2] = -ray / depth[..., None]
    return ray, by


# -- image by image ------------------------------------------------------------------------------


def poses_of(rays: Array, points: Array) -> list[tuple[Array, Array, float]]:
    """Poses ``T_camera_body`` from which points (n, 3), m, are seen along rays (n, 2), best first.

    Returns rotation, translation [m] and cost: both of a plane that look alike, at most one of a solid
    shape, none of points on a line.
    """
    import cv2

    middle = points.mean(axis=0)
    _, size, axes = np.linalg.svd(points - middle, full_matrices=False)
    if len(points) < _LEAST or size[1] <= _LINE * size[0]:
        return []
    axes *= np.linalg.det(axes)
    local, flat = (points - middle) @ axes.T, size[2] < _PLANE * size[0]
    way = cv2.SOLVEPNP_IPPE if flat else cv2.SOLVEPNP_SQPNP
    local[:, 2] *= not flat
    try:
        _, turns, shifts, errors = cv2.solvePnPGeneric(local, rays, np.eye(3), None, flags=way)
    except cv2.error:  # of rays that are those of no shape
        return []
    poses = []
    for turn, shift, error in zip(turns, shifts, np.ravel(errors), strict=False):
        R, t = so3_exp(turn[:, 0]) @ axes, shift[:, 0]
        if np.isfinite(t).all() and np.isfinite(R).all() and t[2] > _NEAR:
            cost = 2.0 * len(rays) * float(error / _RESOLUTION) ** 2
            poses.append((R, t - R @ middle, cost))
    return sorted(poses, key=lambda pose: pose[2])[: 2 if flat else 1]


def _views(ideal: Array, seen: Mask, bodies: tuple[Ridden, ...]) -> tuple[Motions, Mask]:
    """The better pose of B bodies in m images, shape (m, B), and where enough of a body is seen."""
    m, count = len(ideal), len(bodies)
    R, t = np.tile(np.eye(3), (m, count, 1, 1)), np.zeros((m, count, 3))
    whole = np.zeros((m, count), dtype=bool)
    for k, body in enumerate(bodies):
        channels = body.channels
        images = np.flatnonzero(seen[:, channels].sum(axis=1) >= _LEAST)
        if len(images) > _POSED:
            images = images[np.linspace(0, len(images) - 1, _POSED).astype(int)]
        for i in images.tolist():
            here = seen[i, channels]
            poses = poses_of(ideal[i, channels][here], body.points[here])
            if poses:
                R[i, k], t[i, k], _ = poses[0]
                whole[i, k] = True
    return (R, t), whole


def _by_hand_eye(ideal: Array, seen: Mask, mounted: Mounted, images: _Images) -> Iterator[Array]:
    """Values (1, p) by the poses of each body in each image, where any is seen often enough.

    What is not seen whole often enough stays where it is guessed.
    """
    (R, t), whole = _views(ideal, seen, mounted.bodies)
    bodies, camera = mounted.bodies, mounted.camera
    if mounted.known:  # seen from the base then
        back = camera[0].T
        R, t = back @ R, rotate(back, t - camera[1])
    known = np.array([body.known for body in bodies])
    count = whole.sum(axis=0)
    use = np.flatnonzero((count >= _ENOUGH) | ((count > 0) & known)).tolist()
    if not use:
        return
    corners = np.concatenate([corners_of(bodies[k].R, bodies[k].t) for k in use])
    free = np.repeat(~known[use], CORNERS)[:, None] & np.ones(3, dtype=bool)
    arm = Nominal(*mounted.arm, corners, free, mounted.known)
    R_base, t_base, corners = hand_eye((R[:, use], t[:, use]), whole[:, use], arm)
    origins, axes = frame_of(corners)
    places = [(body.R, body.t) for body in bodies]
    for k, origin, turn in zip(use, origins, axes, strict=True):
        places[k] = turn.T, origin
    yield images.at(camera if mounted.known else (R_base, t_base), places)[None]
