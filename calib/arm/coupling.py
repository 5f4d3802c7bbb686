"""How a small motion anywhere in the arm changes the deflection everywhere else.

Moving a frame moves the loads, which changes the wrench at every elastic frame, which moves the loads
again. With y_k the motion that elastic frame k adds and V_l the motion of frame l itself, both as
velocity fields,

    y_k = T_k K_k (whole_k sum_{l<=k} (V_l + y_l) + beyond sum_{l>k} (V_l + y_l)) .

Few components of a wrench bend a frame, of a joint's compliance the moment about its axis alone: how
these change, at all elastic frames together, is what a small linear system is solved for at each pose.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from calib.arm.kinematics import Frames, spatial_columns
from calib.arm.se3 import cross
from calib.arm.statics import Loads, Transmitted, change_beyond
from calib.arrays import Array, IntArray


def coupled(
    own: Array,
    acts_at: IntArray,
    loaded: Array,
    elastic: Mapping[int, Array],
    loads: Loads,
    frames: Frames,
    wrench: Transmitted,
) -> Array:
    """Motion of the tip for each parameter, the deflection that it causes included.

    own : ndarray, shape (..., m, 6, p), velocity field of each parameter's own displacement
    acts_at : ndarray of int, shape (p,), frame that each parameter displaces
    loaded : ndarray, shape (..., m, n + 2, 6, p), wrench that each parameter adds to the frames
    elastic : dict, frame -> ndarray, shape (..., m, 6, 6), flexibility
    Returns ndarray, shape (..., m, 6, p), base axes.
    """
    felt = {k: np.flatnonzero(K.any(axis=(*range(K.ndim - 2), -2))) for k, K in elastic.items()}
    at, component = np.repeat([*felt], [len(c) for c in felt.values()]), np.hstack([*felt.values()])
    beyond = change_beyond(loads, frames, wrench)
    axis = np.swapaxes(frames.R, -1, -2)[..., at, component % 3, :]
    near = _as_one(axis, component, beyond[..., at, :, 3:], frames.o[..., at, :], wrench, at)
    far = axis * (component >= 3)[:, None]

    def change(motion: Array, acts_at: IntArray) -> Array:
        moments = _moments(beyond, motion, acts_at)
        turned = near @ motion[..., 3:, :]
        return np.where(acts_at <= at[:, None], turned, far @ moments)

    follow = np.concatenate(
        [spatial_columns(frames.present, k, elastic[k][..., c]) for k, c in felt.items()], axis=-1
    )
    given = change(own, acts_at) + loaded[..., at, component, :]
    bent = follow @ np.linalg.solve(np.eye(len(at)) - change(follow, at), given)
    return np.asarray(own + bent)


def _as_one(
    axis: Array, component: IntArray, turn: Array, o: Array, wrench: Transmitted, at: IntArray
) -> Array:
    """How components of a frame's wrench follow its turning with all beyond it, (..., m, K, 3).

    axis : ndarray, shape (..., m, K, 3), base axes, of each component at its frame ``at``
    turn : ndarray, shape (..., m, K, 3, 3), what turning changes of the moment about a point that rests
    o : ndarray, shape (..., m, K, 3), m, origins of the frames
    The loads keep their direction while the axes turn; a shift changes nothing.
    """
    force = cross(axis, wrench.force[..., at, :])
    moment = np.einsum("...i,...ij->...j", axis, turn) - cross(force, o)
    moment = moment + cross(axis, wrench.moment[..., at, :])
    return np.ascontiguousarray(np.where((component >= 3)[:, None], moment, force))


def _moments(beyond: Array, motion: Array, acts_at: IntArray) -> Array:
    """Change of the moments by motions (..., m, 6, p) of all beyond the frames where they act."""
    batch = np.broadcast_shapes(beyond.shape[:-3], motion.shape[:-2])
    out = np.empty((*batch, 3, motion.shape[-1]))
    for frame in np.unique(acts_at):
        own = acts_at == frame
        out[..., own] = beyond[..., frame, :, :] @ motion[..., own]
    return out
