"""Where the base stands and where the markers sit, from nothing but the readings.

With the nominal arm, ``y_ij = t + R (p_i + R_i u_j)``. Turned back by ``S = R^T`` this is linear in S,
``S t`` and the ``u_j``. The latter two are eliminated exactly, which leaves a quadratic form on the
rotations: small, cheap, and minimised from many starts at once, so the instrument may stand
anywhere, turned anyhow, and one marker is enough.
"""

from __future__ import annotations

import numpy as np

from calib.arm.kinematics import forward
from calib.arm.se3 import nearest_rotation, rotate, skew, so3_exp, so3_log, so3_right_jacobian
from calib.arrays import Array, Mask
from calib.effects.base import Base
from calib.effects.tool import Tool
from calib.identification.solver import levenberg_marquardt
from calib.model import Model
from calib.observations.shape import free_components
from calib.poses import Measurements

_STARTS = 256
_FOLLOWED = 12  # the best of them
_RESOLUTION = 1e-6  # m: what the search takes for one standard deviation


def initial_values(model: Model, data: Measurements) -> Array:
    """Values of all parameters, base and markers from the data, the rest nominal, shape (p,)."""
    values = model.initial
    frames = forward(model.robot, data.poses.q)
    R_tip, p_tip = frames.R[:, -1], frames.o[:, -1]
    markers = model.markers.copy()
    free = free_components(model)
    has_base = any(isinstance(e, Base) for e in model.effects)
    if not free.any() and not has_base:
        return values
    counts = np.bincount(data.poses.station, minlength=len(data.poses.stations))
    for station in np.argsort(-counts):
        here = data.poses.station == station
        if not here.any():
            continue
        R, t, markers = _place(
            data.points[here], data.seen[here], R_tip[here], p_tip[here], markers, free, has_base
        )
        free = (
            free & (data.seen[here].sum(axis=0) == 0)[:, None]
        )  # later stations see the same markers
        for effect, part in zip(model.effects, model.slices, strict=True):
            if isinstance(effect, Base) and effect.station == station:
                values[part] = np.concatenate([t, so3_log(R)])
    for effect, part in zip(model.effects, model.slices, strict=True):
        if isinstance(effect, Tool):
            offset = markers[effect.marker] - model.markers[effect.marker]
            values[part] = offset[list(effect.components)]
    return values


def _place(
    points: Array,
    seen: Mask,
    R_tip: Array,
    p_tip: Array,
    markers: Array,
    free: Mask,
    has_base: bool,
) -> tuple[Array, Array, Array]:
    """Rotation and translation of the base in the readings' frame, and the markers in the tip's."""
    pose, marker = np.nonzero(seen)
    free = free & (seen.sum(axis=0) > 0)[:, None]
    known = np.where(free, 0.0, markers)
    y, arm = points[pose, marker], p_tip[pose] + rotate(R_tip[pose], known[marker])
    first = 3 if has_base else 0
    design = np.zeros((len(pose), 3, first + int(free.sum())))
    design[:, :, :first] = np.eye(3)[:, :first]
    for column, (j, component) in enumerate(np.argwhere(free), start=first):
        design[marker == j, :, column] = R_tip[pose[marker == j], :, component]
    D = design.reshape(-1, design.shape[-1])
    S: Array = _rotation(D, y, arm) if has_base else np.eye(3)
    solution = np.asarray(np.linalg.lstsq(D, (y @ S.T - arm).reshape(-1), rcond=None)[0])
    t = S.T @ solution[:3] if has_base else np.zeros(3)
    placed = markers.copy()
    placed[free] = solution[first:]
    return S.T, t, placed


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
