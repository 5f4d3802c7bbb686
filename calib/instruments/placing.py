"""Where the base stands and where the markers sit, from nothing but the readings.

With the nominal arm, ``y_ij = t + R (p_i + R_i u_j)``. Turned back by ``S = R^T`` this is linear in S,
``S t`` and the ``u_j``. The latter two are eliminated exactly, which leaves a quadratic form on the
rotations: small, cheap, and minimised from many starts at once, so the instrument may stand
anywhere, turned anyhow, and one marker is enough.
"""

from __future__ import annotations

import numpy as np

from calib.arm.se3 import nearest_rotation, rotate, skew, so3_exp, so3_log, so3_right_jacobian
from calib.arrays import Array, Mask
from calib.instruments.protocol import Nominal
from calib.solver import levenberg_marquardt

_STARTS = 256
_FOLLOWED = 12  # the best of them
_RESOLUTION = 1e-6  # m: what the search takes for one standard deviation


def placed(points: Array, seen: Mask, arm: Nominal) -> tuple[Array, Array, Array]:
    """Rotation and translation of the base in the readings' frame, and the markers in the tip's.

    points : ndarray, shape (m, M, 3), m; seen : ndarray of bool, shape (m, M)
    """
    pose, marker = np.nonzero(seen)
    free = arm.free & (seen.sum(axis=0) > 0)[:, None]
    known, R_tip = np.where(free, 0.0, arm.markers), arm.R_tip[pose]
    y, there = points[pose, marker], arm.p_tip[pose] + rotate(R_tip, known[marker])
    first = 0 if arm.placed else 3
    design = np.zeros((len(pose), 3, first + int(free.sum())))
    design[:, :, :first] = np.eye(3)[:, :first]
    for column, (j, component) in enumerate(np.argwhere(free), start=first):
        design[marker == j, :, column] = R_tip[marker == j, :, component]
    D = design.reshape(-1, design.shape[-1])
    S: Array = np.eye(3) if arm.placed else _rotation(D, y, there)
    solution = np.asarray(np.linalg.lstsq(D, (y @ S.T - there).reshape(-1), rcond=None)[0])
    t = np.zeros(3) if arm.placed else S.T @ solution[:3]
    markers = arm.markers.copy()
    markers[free] = solution[first:]
    return S.T, t, markers


def _rotation(D: Array, y: Array, arm: Array) -> Array:
    """The S in SO(3) that minimises the part of ``S y - arm`` outside the span of D."""
    U, s, _ = np.linalg.svd(D, full_matrices=False)
    basis = np.asarray(U[:, s > 1e-9 * s[0]])
    # Row c of S y is S[c] . y: columns of Z belong to the nine entries of S, then to arm.
    Z = np.concatenate(
        [np.einsum("nk,cd->ncdk", y, np.eye(3)).reshape(-1, 9), arm.reshape(-1, 1)], 1
    )
    Z = Z - basis @ (basis.T @ Z)
    R = np.asarray(np.linalg.qr(Z, mode="r"))
    factor, target = R[:, :9] / _RESOLUTION, R[:, 9] / _RESOLUTION

    def linearise(r: Array) -> tuple[Array, Array]:
        S = so3_exp(r)
        columns = S[..., None, :, :] @ skew(np.eye(3))  # d S = S skew(J dr)
        dS = np.einsum("...kab,...kj->...jab", columns, so3_right_jacobian(r))
        flat = dS.reshape((*dS.shape[:-2], 9))
        residual = target - S.reshape((*S.shape[:-2], 9)) @ factor.T
        return residual, np.swapaxes(flat @ factor.T, -1, -2)

    free = np.asarray(np.linalg.lstsq(factor, target, rcond=1e-9)[0]).reshape(3, 3)
    random = np.random.default_rng(0).normal(size=(_STARTS - 1, 4))
    starts = np.concatenate([so3_log(nearest_rotation(free))[None], _rotation_vectors(random)])
    cost = np.sum(linearise(starts)[0] ** 2, axis=-1)
    found = levenberg_marquardt(linearise, starts[np.argsort(cost)[:_FOLLOWED]], np.eye(3))
    return so3_exp(found.values[int(np.argmin(found.cost))])


def _rotation_vectors(quaternions: Array) -> Array:
    q = quaternions / np.linalg.norm(quaternions, axis=-1, keepdims=True)
    q = np.where(q[:, :1] < 0, -q, q)
    sine = np.linalg.norm(q[:, 1:], axis=-1, keepdims=True)
    return np.asarray(2.0 * np.arctan2(sine, q[:, :1]) * q[:, 1:] / sine)
