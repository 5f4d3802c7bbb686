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
from calib.arm.statics import Loads, Transmitted, rigid_change
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
    whole, beyond = rigid_change(loads, frames, wrench)
    # Rows that read those components of what moves the frame too, and of moments from beyond it.
    near = whole[..., at, component, :]
    far = np.swapaxes(frames.R, -1, -2)[..., at, component - 3, :] * (component >= 3)[:, None]

    def change(motion: Array, acts_at: IntArray) -> Array:
        moments = _moments(beyond, motion, acts_at)
        return np.where(acts_at <= at[:, None], near @ motion, far @ moments)

    follow = np.concatenate(
        [spatial_columns(frames.present, k, elastic[k][..., c]) for k, c in felt.items()], axis=-2
    )
    follow = np.swapaxes(follow, -1, -2)
    given = change(own, acts_at) + loaded[..., at, component, :]
    bent = follow @ np.linalg.solve(np.eye(len(at)) - change(follow, at), given)
    return np.asarray(own + bent)


def _moments(beyond: Array, motion: Array, acts_at: IntArray) -> Array:
    """Change of the moments by motions (..., m, 6, p) of all beyond the frames where they act."""
    batch = np.broadcast_shapes(beyond.shape[:-3], motion.shape[:-2])
    out = np.empty((*batch, 3, motion.shape[-1]))
    for frame in np.unique(acts_at):
        own = acts_at == frame
        out[..., own] = beyond[..., frame, :, :] @ motion[..., own]
    return out
