"""Whether poses that were read again had moved on with time: evidence of a steady rigid motion."""

from __future__ import annotations

import numpy as np

from calib.arrays import Array, IntArray
from calib.observations.shape import rigid_motions
from calib.poses import Measurements
from calib.poses.moves import alike, visits


def drift_p(data: Measurements) -> float | None:
    """Probability by chance that points at equal joints and loads move as steadily, None without any.

    Only points that every such reading shows are compared. The mean displacement of each visit from its
    pose's mean is regressed on six rates of a rigid motion. An F test sets what they explain against
    the rest of the rigid displacements.
    """
    from scipy.special import fdtrc

    poses, state, stay = data.poses, alike(data.poses), visits(data.poses)
    each = np.unique(np.column_stack([state, stay]), axis=0)[:, 0]
    again = np.flatnonzero(np.bincount(each)[state] > 1)
    seen = data.seen[again].all(axis=0)
    if not (len(again) and seen.any()):
        return None
    state, stay = (np.unique(of[again], return_inverse=True)[1] for of in (state, stay))
    points, clock = data.points[again][:, seen], poses.clock[again]
    turned = rigid_motions(_mean(points, stay) - points.mean(axis=(0, 1)))
    moved, later = (_mean(a - _mean(a, state)[state], stay) for a in (points, clock))
    own = np.swapaxes(turned, 1, 2) @ turned
    along = np.einsum("vrk,vr->vk", turned, moved.reshape(turned.shape[:2]))
    N, b = np.tensordot(later**2, own, 1), later @ along
    steady = float(b @ np.linalg.pinv(N, rcond=1e-6, hermitian=True) @ b)
    rigid = np.einsum("vk,vkl,vl->", along, np.linalg.pinv(own, rcond=1e-6, hermitian=True), along)
    rank, most = (np.linalg.matrix_rank(A, rtol=1e-6) for A in (N, own[0]))
    places = np.unique(np.column_stack([poses.configuration, poses.station])[again], axis=0)
    dof, other = most * (len(turned) - len(places)) - rank, max(float(rigid) - steady, 1e-300)
    if dof > 0 and rank:  # an arm errs in few of the directions: half of them count
        return float(fdtrc(rank / 2.0, dof / 2.0, steady / rank / other * dof))
    return None


def _mean(values: Array, of: IntArray) -> Array:
    """Means (g, ..) of values (n, ..) over the groups ``of`` (n,), numbered from zero."""
    sums = np.zeros((of.max() + 1, *values.shape[1:]))
    np.add.at(sums, of, values)
    return sums / np.bincount(of).reshape(-1, *[1] * (values.ndim - 1))
