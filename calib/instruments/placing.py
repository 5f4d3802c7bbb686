"""Where an instrument stands and how what it reads sits on the tip, from nothing but the readings.

Of points, with the nominal arm, ``y_ij = t + R (p_i + R_i u_j)``. Turned back by ``S = R^T`` this is
linear in S, ``S t`` and the ``u_j``. The latter two are eliminated exactly, which leaves a quadratic
form on the rotations: small, cheap, and minimised from many starts at once, so the instrument may stand
anywhere, turned anyhow, and one marker is enough.

Of whole poses, ``T_i = Y P_i X`` (hand-eye calibration): ``R_Y^T R_i = R_Pi R_X`` is linear in the
entries of R_Y^T and of every R_X, so they span the null space of a matrix (Andreff, Horaud, Espiau,
IJRR 20(3), 2001, in this form); of axes that are all parallel it has more than one dimension, and a
search from many starts takes over. The translations then follow by linear least squares, of least
length where poses leave them open.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np

from calib.arm.se3 import nearest_rotation, rotate, skew, so3_exp, so3_exp_with_jacobian, so3_log
from calib.arrays import Array, IntArray, Mask, stacked
from calib.instruments.protocol import Nominal
from calib.instruments.rotation import rotation
from calib.solver import levenberg_marquardt

_RESOLUTION = 1e-6  # m or rad: what a search takes for one standard deviation
_TOLD = (
    0.05  # of a lever's length that turns: below, a nominal arm's error would look like a marker's
)


def placed(points: Array, seen: Mask, arm: Nominal) -> tuple[Array, Array, Array]:
    """Rotation and translation of the base in the readings' frame, and the markers in the tip's.

    points : ndarray, shape (m, M, 3), m; seen : ndarray of bool, shape (m, M)
    """
    pose, marker = np.nonzero(seen)
    R_tip = arm.R_tip[pose]
    y, there = points[pose, marker], arm.p_tip[pose] + rotate(R_tip, arm.markers[marker])
    free = arm.free & (seen.sum(axis=0) > 0)[:, None]
    own = np.argwhere(free)
    lever = np.where(marker[:, None, None] == own[:, 0], R_tip[:, :, own[:, 1]], 0.0)
    apart = Apart(lever, arm.placed)
    S: Array = np.eye(3) if arm.placed else rotation(*apart.quadratic(y, there))
    t, offsets = apart.solved(y @ S.T - there)
    markers = arm.markers.copy()
    markers[free] += offsets
    return S.T, S.T @ t, markers


@dataclass(frozen=True, eq=False)
class Apart:
    """``rest = t + lever u`` for rows n of three: a shift common to all, and what turns with the tip.

    lever : ndarray, shape (n, 3, f); placed : whether there is no shift
    Without their means rows speak of u alone. What the tip hardly turns stays as it was guessed: of u
    the directions that are seen are solved for, so u is shorter than twenty times the rest.
    """

    lever: Array
    placed: bool

    @cached_property
    def _directions(self) -> tuple[Array, Array, Array]:
        """Basis (3 n, k) of what u does to the rows, singular values (k,), and directions (k, f)."""
        U, s, Vt = np.linalg.svd(self._flat(self.lever), full_matrices=False)
        told = s > _TOLD * np.linalg.norm(self.lever, axis=(0, 1)).max(initial=0.0)
        return U[:, told], s[told], Vt[told]

    def _flat(self, rows: Array) -> Array:
        if not self.placed:
            rows = rows - rows.mean(axis=0)
        return stacked(rows)

    def solved(self, rest: Array) -> tuple[Array, Array]:
        """The shift (3,) and u (f,) of rest (n, 3), m; u of least length."""
        U, s, Vt = self._directions
        u = Vt.T @ ((U.T @ self._flat(rest[..., None])[:, 0]) / s)
        if self.placed:
            return np.zeros(3), u
        return (rest - self.lever @ u).mean(axis=0), u

    def quadratic(self, y: Array, there: Array) -> tuple[Array, Array]:
        """Factor (k, 9) and target (k,) of ``target - factor S``: what neither t nor u explains.

        y, there : ndarray, shape (n, 3), m, of ``S y - there``
        """
        basis = self._directions[0]
        # Row c of S y is S[c] . y: columns of Z belong to the nine entries of S, then to the arm.
        of_S = np.einsum("nk,cd->ncdk", y, np.eye(3)).reshape(len(y), 3, 9)
        Z = self._flat(np.concatenate([of_S, there[..., None]], axis=-1))
        R = np.asarray(np.linalg.qr(Z - basis @ (basis.T @ Z), mode="r"))
        return R[:, :9] / _RESOLUTION, R[:, 9] / _RESOLUTION


Motions: TypeAlias = tuple[Array, Array]
"""Rotations (..., 3, 3) and translations (..., 3), m."""

Quadratic: TypeAlias = tuple[Array, Array]
"""Factor (k, 9) and target (k,) of what points leave, ``target - factor S``."""

_APART = 5.0  # times the smallest singular value: above, the next one is none of the null space
_TURNED = (
    0.1  # relative to the largest: of a flange that turns less, errors of the arm tell as much
)
_POSE_STARTS = 64
_POSE_FOLLOWED = 6  # the best of them
_SEARCHED = 40  # readings that a search looks at: more tell it nothing new


def hand_eye(
    measured: Motions, seen: Mask, arm: Motions, bodies: Array, known: Mask, placed: bool
) -> tuple[Array, Array, Array]:
    """Rotation and translation of the base in the readings' frame, and the bodies in the tip's.

    measured : of shapes (m, C); arm : of shape (m,), tip in base axes
    bodies : ndarray, shape (C, 3, 3), origin and two axes of each body by rows, guesses but where known
    known : ndarray of bool, shape (C,); placed : whether the base's frame is that of the readings
    """
    pose, body = np.nonzero(seen)
    R_read, p_read = (part[pose, body] for part in measured)
    R_tip, p_tip = (part[pose] for part in arm)
    R_X = np.stack([bodies[:, 1], bodies[:, 2], np.cross(bodies[:, 1], bodies[:, 2])], axis=-1)
    p_X = bodies[:, 0]
    own = np.flatnonzero(~known)
    there = p_tip + rotate(R_tip, p_X[body])
    lever = np.where(body[:, None, None, None] == own[:, None], R_tip[:, :, None], 0.0)
    apart = Apart(lever.reshape(len(body), 3, -1), placed)
    R_Y, R_X = _rotations(R_read, R_tip, body, R_X, known, placed, apart.quadratic(p_read, there))
    t, moved = apart.solved(rotate(R_Y.T, p_read) - there)
    p_X = p_X.copy()
    p_X[own] += moved.reshape(-1, 3)
    axes = np.swapaxes(R_X[:, :, :2], -1, -2)
    return R_Y, R_Y @ t, np.concatenate([p_X[:, None], axes], axis=1)


def _rotations(
    R_read: Array,
    R_tip: Array,
    body: IntArray,
    R_X: Array,
    known: Mask,
    placed: bool,
    points: Quadratic,
) -> tuple[Array, Array]:
    """Rotations of the place and of every body, by the readings n.

    points : what the bodies' origins say of the place's
    """
    if placed:
        back = np.swapaxes(R_tip, -1, -2) @ R_read
        return np.eye(3), _averaged(back, body, R_X, known)
    if known.any():
        own = known[body]
        there = R_tip[own] @ R_X[body[own]]
        R_Y = nearest_rotation((R_read[own] @ np.swapaxes(there, -1, -2)).sum(axis=0))
    else:
        R_Y = _place(R_read, R_tip, body, len(R_X), points)
    back = np.swapaxes(R_tip, -1, -2) @ R_Y.T @ R_read
    return R_Y, _averaged(back, body, R_X, known)


def _averaged(back: Array, body: IntArray, R_X: Array, known: Mask) -> Array:
    """Each unknown body's rotation, as all of its readings (n, 3, 3) have it."""
    found = R_X.copy()
    for c in np.unique(body):
        if not known[c]:
            found[c] = nearest_rotation(back[body == c].sum(axis=0))
    return found


def _place(R_read: Array, R_tip: Array, body: IntArray, count: int, points: Quadratic) -> Array:
    """R_Y with every body unknown: the null space, and a search from there and from anywhere."""
    n, eye = len(body), np.eye(3)
    rows = np.zeros((n, 9, 1 + count, 9))
    rows[:, :, 0] = np.einsum("ij,nkl->niljk", eye, R_read).reshape(n, 9, 9)
    rows[np.arange(n), :, 1 + body] = -np.einsum("nij,kl->niljk", R_tip, eye).reshape(n, 9, 9)
    _, s, Vt = np.linalg.svd(np.linalg.qr(rows.reshape(9 * n, -1), mode="r"))
    S = Vt[-1, :9].reshape(3, 3)
    first = nearest_rotation(S * np.sign(np.linalg.det(S)))
    if s[-2] > max(_APART * s[-1], _TURNED * s[0]):
        return first.T
    chosen = np.unique(np.linspace(0, n - 1, _SEARCHED).astype(int))
    return _searched(first, R_read[chosen], R_tip[chosen], body[chosen], count, points).T


def _searched(
    first: Array, R_read: Array, R_tip: Array, body: IntArray, count: int, points: Quadratic
) -> Array:
    """The S = R_Y^T from which the bodies' rotations and origins scatter least."""
    factor, target = points
    wide = np.zeros((len(body), 1 + count))
    wide[np.arange(len(body)), 1 + body] = 1.0
    columns = skew(np.eye(3))  # of a derivative, d exp(r) = exp(r) skew(J dr)

    def linearise(r: Array) -> tuple[Array, Array]:
        r = r.reshape((*r.shape[:-1], 1 + count, 3))
        R, turn = so3_exp_with_jacobian(r)
        S, X = R[..., :1, :, :], R[..., 1:, :, :][..., body, :, :]
        off = S @ R_read - R_tip @ X
        dS = S[..., None, :, :] @ columns @ R_read[:, None]
        dS = np.einsum("...nkab,...kj->...nabj", dS, turn[..., 0, :, :])
        dX = (R_tip @ X)[..., None, :, :] @ columns
        dX = np.einsum("...nkab,...nkj->...nabj", dX, turn[..., 1:, :, :][..., body, :, :])
        J = -np.einsum("...nabj,nc->...nabcj", dX, wide)
        J[..., 0, :] = dS
        J = J.reshape((*r.shape[:-2], 9 * len(body), -1)) / _RESOLUTION
        turned = S[..., 0, None, :, :] @ columns
        turned = np.einsum("...kab,...kj->...jab", turned, turn[..., 0, :, :])
        by_place = factor @ np.swapaxes(turned.reshape((*r.shape[:-2], 3, 9)), -1, -2)
        by_points = np.zeros((*by_place.shape[:-1], J.shape[-1]))
        by_points[..., :3] = by_place
        apart = target - S.reshape((*r.shape[:-2], 9)) @ factor.T
        rows = np.concatenate([off.reshape(J.shape[:-1]) / _RESOLUTION, apart], axis=-1)
        return rows, np.concatenate([-J, by_points], axis=-2)

    drawn = np.random.default_rng(0).normal(size=(_POSE_STARTS - 1, 3, 3))
    starts = np.concatenate([first[None], nearest_rotation(drawn)])
    back = np.swapaxes(R_tip, -1, -2) @ starts[:, None] @ R_read
    bodies = [nearest_rotation(back[:, body == c].sum(axis=1)) for c in range(count)]
    r = so3_log(np.stack([starts, *bodies], axis=1)).reshape(_POSE_STARTS, -1)
    r = r[np.argsort(np.sum(linearise(r)[0] ** 2, axis=-1))[:_POSE_FOLLOWED]]
    found = levenberg_marquardt(linearise, r, np.eye(r.shape[-1]))
    return so3_exp(found.values[int(np.argmin(found.cost)), :3])
