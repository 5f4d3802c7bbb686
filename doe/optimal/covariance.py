"""The covariance of a plan after one of its poses changed, by an update of low rank."""

from __future__ import annotations

import numpy as np

from calib.arrays import Array


def halved(cov: Array, out: Array) -> Array:
    """Covariance with a pose measured half as well: between what it is with the pose and without.

    cov : ndarray, shape (b, p, p); out : ndarray, shape (b, r, p), the pose's rows
    """
    U = out @ cov
    S = 2.0 * np.eye(out.shape[1]) - U @ np.swapaxes(out, 1, 2)
    return np.asarray(cov + np.swapaxes(U, 1, 2) @ np.linalg.solve(S, U))


def exchanged(cov: Array, out: Array, into: Array) -> Array:
    """Covariance with one pose in place of another, shape (b, k, p, p).

    Both at once: without the pose that goes the information may well be singular.

    cov : ndarray, shape (b, p, p); out : ndarray, shape (b, r, p); into : ndarray, shape (b, k, r, p)
    """
    r = out.shape[1]
    both = np.concatenate([into, np.broadcast_to(out[:, None], into.shape)], axis=2)
    U = both @ cov[:, None]
    S = U @ np.swapaxes(both, 2, 3) + np.diag(np.repeat([1.0, -1.0], r))
    return np.asarray(cov[:, None] - np.swapaxes(U, 2, 3) @ np.linalg.solve(S, U))
