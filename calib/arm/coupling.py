"""How a small motion anywhere in the arm changes the deflection everywhere else.

Moving a frame moves the loads, which changes the wrench at every elastic frame, which moves the loads
again. With y_k the motion that elastic frame k adds and V_l the motion of frame l itself, both as
velocity fields,

    y_k = T_k K_k (whole_k sum_{l<=k} (V_l + y_l) + beyond sum_{l>k} (V_l + y_l)) ,

solved by Gauss-Seidel from the tip to the base: a round gains the factor compliance x load x lever,
about two digits.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from calib.arm.kinematics import Frames, spatial_columns
from calib.arm.statics import Loads, Transmitted, rigid_change
from calib.arrays import Array, IntArray

_SETTLED = 1e-9  # relative change
_MOST_ROUNDS = 30


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
    whole, beyond = rigid_change(loads, frames, wrench)
    per_parameter = np.take(beyond, acts_at, axis=-3)  # (..., m, p, 3, 6)
    pulls = np.einsum("...pij,...jp->...ip", per_parameter, own, optimize=True)
    order = sorted(elastic, reverse=True)
    follow, driven = {}, {}
    for k in order:
        # Velocity field at k for a unit wrench there, times what each wrench column contributes.
        follow[k] = np.swapaxes(spatial_columns(frames.present, k, elastic[k]), -1, -2)
        drive = whole[..., k, :, :] @ (own * (acts_at <= k)) + loaded[..., k, :, :]
        turned = np.swapaxes(frames.R[..., k, :, :], -1, -2)
        drive[..., 3:, :] += turned @ (pulls * (acts_at > k))
        driven[k] = follow[k] @ drive
    y = {k: driven[k] for k in order}
    for _ in range(_MOST_ROUNDS):
        change = 0.0
        for k in order:
            near = sum((y[j] for j in order if j <= k), np.zeros(()))
            drive = whole[..., k, :, :] @ near
            far = [beyond[..., j, :, :] @ y[j] for j in order if j > k]
            if far:
                drive[..., 3:, :] += np.swapaxes(frames.R[..., k, :, :], -1, -2) @ sum(far)
            new = driven[k] + follow[k] @ drive
            change = max(change, float(np.abs(new - y[k]).max(initial=0.0)))
            y[k] = new
        if change <= _SETTLED * max(float(np.abs(y[k]).max(initial=0.0)) for k in order):
            break
    return own + sum(y.values())
