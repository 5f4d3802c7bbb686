"""A camera's place, and those of the bodies that it sees, from the rays of many images together.

The arm moves a camera before bodies, or bodies before a camera: ``x ~ T_camera A_i T_body p`` with A_i
the arm at image i, from the tip to the base or back. Several starts are laid over the rays and the best
of them followed: what the cell says; hand-eye calibration by the poses of each body in each image, of
which two look alike (:mod:`calib.instruments.posit`); and bodies turned and shifted at random about
where they ride, which makes all their points one shape that the camera sees at once.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np

from calib.arm.se3 import fit_rigid, moved_as_one, nearest_rotation, rotate, so3_exp, so3_log
from calib.arrays import Array, IntArray, Mask
from calib.instruments.placing import Motions, hand_eye
from calib.instruments.posit import LEAST, RESOLUTION, posed, rays_to, refined
from calib.instruments.protocol import Nominal
from calib.instruments.riding import CORNERS, corners_of, frame_of
from calib.solver import levenberg_marquardt

Shape: TypeAlias = tuple[slice, Array]
"""Positions among the readings, and the points (n, 3), m, in the board's frame."""

_ENOUGH = 3  # images of a body that fix it beside the camera
_POSED = 60  # images of a body that are looked at by themselves
_SURE = 9.0  # times the cost of the better pose: the other one is none
_TURNS = 5  # of hand-eye calibration and choice
_DRAWN = 32  # places of bodies
_FOLLOWED = 8  # starts, the best of them
_SEARCHED = 240  # readings that a search looks at: more tell it nothing new
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

    arm : of shape (m,), from what carries to where the camera sees the base
    camera : where it sees that base; known : whether that is so, or a guess
    """

    arm: Motions
    bodies: tuple[Ridden, ...]
    camera: Motions
    known: bool


class Resected(NamedTuple):
    """Places found: of the base in the camera's frame, of every body; and the focal length's factor."""

    R: Array
    t: Array
    bodies: list[Motions]
    focal: float


def on_tip(arm: Nominal, shapes: tuple[Shape, ...]) -> tuple[Ridden, ...]:
    """The boards and then the markers of the tip, as bodies."""
    found = []
    for own, points in shapes:
        T = fit_rigid(arm.markers[own], points)
        found.append(Ridden(own, points, T[:3, :3], T[:3, 3], not arm.free[own].any()))
    taken = {c for own, _ in shapes for c in range(own.start, own.stop)}
    for j in sorted(set(range(len(arm.markers))) - taken):
        known = not arm.free[j].any()
        found.append(Ridden(slice(j, j + 1), np.zeros((1, 3)), np.eye(3), arm.markers[j], known))
    return tuple(found)


def resected(ideal: Array, seen: Mask, mounted: Mounted, focal: bool = False) -> Resected:
    """The places from which the rays of all images fit.

    ideal : ndarray, shape (m, C, 2), undistorted ``X / Z`` and ``Y / Z``
    focal : whether rays have one factor in common that is unknown
    """
    images = _images(ideal, seen, mounted, focal)
    guessed = images.at(mounted.camera, [(body.R, body.t) for body in mounted.bodies])
    by_hand_eye = _by_hand_eye(ideal, seen, mounted, images)
    start = np.concatenate([guessed[None], *by_hand_eye, *images.anyhow(guessed, mounted.known)])
    cost = np.sum(images.linearise(start)[0] ** 2, axis=-1)
    best = start[np.argsort(np.nan_to_num(cost, nan=np.inf))[:_FOLLOWED]]
    found = levenberg_marquardt(images.linearise, best, images.span)
    values = found.values[int(np.argmin(found.cost))]
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

    def of(self, body: Ridden) -> Mask:
        """Which readings are of a body."""
        own = body.channels
        return np.asarray((self.channel >= own.start) & (self.channel < own.stop))

    def linearise(self, values: Array) -> tuple[Array, Array]:
        """Residuals (..., 2 n) of the rays, and their derivatives (..., 2 n, p)."""
        u, by = self._ridden(values)
        points = self.p_arm + rotate(self.R_arm, u)
        viewed, R, by_place = moved_as_one(values[..., _CAMERA], points)
        rays, by_point = rays_to(viewed)
        J = by_point @ (R @ (self.R_arm @ by))
        J[..., _CAMERA] = by_point @ by_place
        factor = values[..., None, None, _FOCAL]
        J = J * factor[..., None]
        J[..., _FOCAL] = rays
        r = (self.rays - factor * rays).reshape((*values.shape[:-1], -1))
        return r / RESOLUTION, J.reshape((*r.shape, len(self.span))) / RESOLUTION

    def _ridden(self, values: Array) -> tuple[Array, Array]:
        """Where the points read ride on the arm (..., n, 3), and the derivatives (..., n, 3, p)."""
        u = np.zeros((*values.shape[:-1], *self.p_arm.shape))
        J = np.zeros((*u.shape, len(self.span)))
        for body, part in zip(self.bodies, self.parts, strict=True):
            here = self.of(body)
            local = body.points[self.channel[here] - body.channels.start]
            u[..., here, :], _, J[..., here, :, part] = moved_as_one(values[..., part], local)
        return u, J

    def at(self, camera: Motions, places: list[Motions]) -> Array:
        """The values (p,) of places."""
        each = [np.concatenate([t, so3_log(R)]) for R, t in (camera, *places)]
        return np.concatenate([each[0], [1.0], *each[1:]])

    def anyhow(self, guessed: Array, known: bool) -> Iterator[Array]:
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
        if len(self.rays) < LEAST:
            return
        points = self.p_arm + rotate(self.R_arm, self._ridden(start)[0])
        R, t, sound = posed(np.broadcast_to(self.rays, (count, *self.rays.shape)), points)
        for way in (0, 1):
            start[:, _CAMERA] = np.concatenate([t[:, way], so3_log(R[:, way])], axis=-1)
            yield start[sound]


_ABOUT = 0.3  # of the extent of the arm's motion: how far from it a body rides


def _images(ideal: Array, seen: Mask, mounted: Mounted, focal: bool) -> _Images:
    pose, channel = np.nonzero(seen)
    if len(pose) > _SEARCHED:
        chosen = np.unique(np.linspace(0, len(pose) - 1, _SEARCHED).astype(int))
        pose, channel = pose[chosen], channel[chosen]
    free = [*[not mounted.known] * 6, focal]
    for body in mounted.bodies:
        read = bool(seen[:, body.channels].any())
        moves, turns = read and not body.known, len(body.points) > 1
        free += [*[moves] * 3, *[moves and turns] * 3]
    (R, p), span = mounted.arm, np.eye(len(free))[:, np.array(free)]
    return _Images(ideal[pose, channel], R[pose], p[pose], channel, mounted.bodies, span)


# -- hand-eye calibration ------------------------------------------------------------------------


def _by_hand_eye(ideal: Array, seen: Mask, mounted: Mounted, images: _Images) -> Iterator[Array]:
    """Values (1, p) by the poses of each body in each image: by all of them, and by the sure ones.

    What is not seen whole often enough goes where the rays of its points meet.
    """
    bodies = mounted.bodies
    R, t, cost, whole = body_poses(ideal, seen, bodies)
    sure = whole & (cost[..., 1] > _SURE * np.maximum(cost[..., 0], seen.shape[1]))
    known = np.array([body.known for body in bodies])
    for trusted in (whole, sure):
        count = trusted.sum(axis=0)
        use = np.flatnonzero((count >= _ENOUGH) | ((count > 0) & known)).tolist()
        if not use:
            continue
        measured = R[:, use], t[:, use]
        own = mounted._replace(bodies=tuple(bodies[k] for k in use))
        camera, found = _chosen(measured, whole[:, use], trusted[:, use], own)
        places = [(body.R, body.t) for body in bodies]
        for k, body in enumerate(bodies):
            if k in use:
                places[k] = found[use.index(k)]
            elif not body.known:
                places[k] = _met(images, body, camera)
        yield images.at(camera, places)[None]


def body_poses(
    ideal: Array, seen: Mask, bodies: tuple[Ridden, ...]
) -> tuple[Array, Array, Array, Mask]:
    """``T_camera_body`` of every body in every image, both that look alike: (m, B, 2), best first.

    Returns rotations, translations, costs, and where there is enough of it, (m, B).
    """
    m, count = len(ideal), len(bodies)
    R, t = np.tile(np.eye(3), (m, count, 2, 1, 1)), np.zeros((m, count, 2, 3))
    cost, whole = np.full((m, count, 2), np.inf), np.zeros((m, count), dtype=bool)
    for k, body in enumerate(bodies):
        own = body.channels
        enough = np.flatnonzero(seen[:, own].sum(axis=1) >= LEAST)
        if len(enough) > _POSED:
            enough = enough[np.linspace(0, len(enough) - 1, _POSED).astype(int)]
        for here, at in _alike(seen[enough, own]):
            rows = enough[at]
            points = np.broadcast_to(body.points[here], (len(rows), int(here.sum()), 3))
            R[rows, k], t[rows, k], whole[rows, k] = posed(ideal[rows, own][:, here], points)
        good = whole[:, k]
        if good.any():
            rays, shown = ideal[good, None, own], seen[good, None, own]
            poses = refined(rays, shown, body.points, R[good, k], t[good, k])
            best = np.argsort(poses[2], axis=-1)
            each = np.arange(len(best))[:, None]
            R[good, k], t[good, k], cost[good, k] = (part[each, best] for part in poses)
    return R, t, cost, whole


def _alike(seen: Mask) -> Iterator[tuple[Mask, IntArray]]:
    """What is seen (C,), and the images (n,) in which it is that."""
    patterns, which = np.unique(seen, axis=0, return_inverse=True)
    for k, here in enumerate(patterns):
        yield here, np.flatnonzero(which.reshape(-1) == k)


def _chosen(
    measured: Motions, whole: Mask, trusted: Mask, mounted: Mounted
) -> tuple[Motions, list[Motions]]:
    """The camera's and the bodies' places, and in turn which of two poses fits them in each image."""
    (R, t), bodies, camera = measured, mounted.bodies, mounted.camera
    if mounted.known:  # seen from the base then
        back = camera[0].T
        R, t = back @ R, rotate(back, t - camera[1])
    corners = np.concatenate([corners_of(body.R, body.t) for body in bodies])
    free = np.repeat([not body.known for body in bodies], CORNERS)[:, None] & np.ones(3, dtype=bool)
    arm = Nominal(*mounted.arm, corners, free, mounted.known)
    which, using = np.zeros(whole.shape, dtype=int), trusted
    i, b = np.indices(whole.shape)
    for _ in range(_TURNS):
        R_base, t_base, corners = hand_eye((R[i, b, which], t[i, b, which]), using, arm)
        origins, axes = frame_of(corners)
        expected = R_base @ arm.R_tip[:, None] @ np.swapaxes(axes, -1, -2)
        alike = np.einsum("mbij,mbkij->mbk", expected, R)  # 1 + 2 cos of the angle between
        now = alike.argmax(axis=-1)
        if np.array_equal(now, which) and np.array_equal(using, whole):
            break
        which, using = now, whole
    found = [(own.T, origin) for own, origin in zip(axes, origins, strict=True)]
    return (camera if mounted.known else (R_base, t_base)), found


def _met(images: _Images, body: Ridden, camera: Motions) -> Motions:
    """A body turned as guessed, its points where their rays meet, in the least squares sense."""
    here, (R, t) = images.of(body), camera
    if not here.any():
        return body.R, body.t
    x, y = images.rays[here].T
    none = np.zeros_like(x)
    to = np.stack(  # what is zero for a point on the ray
        [np.stack([none - 1.0, none, x], axis=-1), np.stack([none, none - 1.0, y], axis=-1)],
        axis=-2,
    )
    own = rotate(body.R, body.points[images.channel[here] - body.channels.start])
    A = to @ R @ images.R_arm[here]
    at = rotate(images.R_arm[here], own) + images.p_arm[here]
    rest = rotate(to, rotate(R, at) + t)
    u = np.linalg.lstsq(A.reshape(-1, 3), -rest.reshape(-1), rcond=1e-6)[0]
    return body.R, np.asarray(u)
