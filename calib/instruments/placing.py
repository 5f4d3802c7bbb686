"""Where an instrument stands and how what it reads sits on the tip, from nothing but the readings.

Of points, with the nominal arm, ``y_ij = t + R (p_i + R_i u_j)``. Turned back by ``S = R^T`` this is
linear in S, ``S t`` and the ``u_j``. The latter two are eliminated exactly, which leaves a quadratic
form on the rotations: small, cheap, and minimised from many starts at once, so the instrument may stand
anywhere, turned anyhow, and one marker is enough.

Of whole poses, ``T_i = Y P_i X`` (hand-eye calibration), a body is three markers, which are found as if
each moved by itself, and turned as one in the end.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np

from calib.arm.se3 import nearest_rotation, rotate, skew, so3_exp, so3_exp_with_jacobian, so3_log
from calib.arrays import Array, IntArray, Mask, stacked
from calib.instruments.protocol import Nominal
from calib.instruments.riding import CORNERS, corners_of, rigid
from calib.solver import levenberg_marquardt

_STARTS = 256  # rotations
_FOLLOWED = 12  # the best of them
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
    apart = Apart(levers(marker, R_tip, free), arm.placed)
    S: Array = np.eye(3) if arm.placed else rotation(*apart.quadratic(y, there))
    t, offsets = apart.solved(y @ S.T - there)
    markers = arm.markers.copy()
    markers[free] += offsets
    return S.T, S.T @ t, markers


def levers(marker: IntArray, R_tip: Array, free: Mask) -> Array:
    """How readings (n,) of markers follow the components of these that are free, shape (n, 3, f).

    marker : ndarray of int, shape (n,); R_tip : ndarray, shape (n, 3, 3); free : of shape (M, 3)
    """
    own = np.argwhere(free)
    return np.where(marker[:, None, None] == own[:, 0], R_tip[:, :, own[:, 1]], 0.0)


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

    @property
    def whole(self) -> bool:
        """Whether rows tell all of u."""
        return bool(len(self._directions[1]) == self.lever.shape[-1])

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


def rotation(factor: Array, target: Array) -> Array:
    """The S in SO(3) that minimises ``|target - factor S|``, from many starts.

    factor : ndarray, shape (k, 9), on the entries of S row by row; target : ndarray, shape (k,); both
        in standard deviations
    """
    by_turn = np.einsum("kab,cbi->kaci", factor.reshape(-1, 3, 3), skew(np.eye(3)))

    def linearise(r: Array) -> tuple[Array, Array]:
        S, turn = so3_exp_with_jacobian(r)
        by_own = np.einsum("...ac,kaci->...ki", S, by_turn)  # of S exp(w)
        return target - S.reshape((*r.shape[:-1], 9)) @ factor.T, by_own @ turn

    free = np.asarray(np.linalg.lstsq(factor, target, rcond=1e-9)[0]).reshape(3, 3)
    drawn = np.random.default_rng(0).normal(size=(_STARTS - 1, 3, 3))
    starts = so3_log(nearest_rotation(np.concatenate([free[None], drawn])))
    cost = np.sum(linearise(starts)[0] ** 2, axis=-1)
    found = levenberg_marquardt(linearise, starts[np.argsort(cost)[:_FOLLOWED]], np.eye(3))
    return so3_exp(found.values[int(np.argmin(found.cost))])


Motions: TypeAlias = tuple[Array, Array]
"""Rotations (..., 3, 3) and translations (..., 3), m."""


def hand_eye(measured: Motions, seen: Mask, arm: Nominal) -> tuple[Array, Array, Array]:
    """Rotation and translation of the base in the readings' frame, and the bodies in the tip's.

    measured : of shapes (m, C); seen : ndarray of bool, shape (m, C)
    arm : Nominal, whose markers are three points of every body
    Returns these points, shape (C, 3, 3), too; of bodies that are known, or never seen, as they were.
    """
    points = corners_of(*measured).reshape(len(seen), -1, 3)
    R, t, markers = placed(points, np.repeat(seen, CORNERS, axis=1), arm)
    markers = markers.reshape(-1, CORNERS, 3)
    found = arm.free.reshape(len(markers), -1).any(axis=1) & np.any(seen, axis=0)
    markers[found] = rigid(markers[found])
    return R, t, markers
