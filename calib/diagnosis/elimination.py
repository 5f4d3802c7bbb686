"""Which parameters of many do not pay for themselves, one after the other."""

from __future__ import annotations

import numpy as np

from calib.arrays import Array, Mask


def idle(values: Array, cov: Array, price: float) -> tuple[Mask, float]:
    """Which go, shape (k,), and by how much the sum of squares rises without them.

    values : ndarray, shape (k,), estimates; cov : ndarray, shape (k, k), their covariance
    price : float, rise of the sum of squares for which a parameter stays
    Taking one out lets it rise by the squared estimate over its variance; the others follow by their
    covariance. The one that is least worth goes first.
    """
    gone, rise = np.zeros(len(values), dtype=bool), 0.0
    while not gone.all():
        variance = np.where(gone, 1.0, np.maximum(np.diag(cov), 1e-300))
        worth = np.where(gone, np.inf, values**2 / variance)
        i = int(np.argmin(worth))
        if float(worth[i]) >= price:
            break
        share = cov[:, i] / variance[i]
        values, cov = values - share * values[i], cov - np.outer(share, cov[i])
        gone[i], rise = True, rise + float(worth[i])
    return gone, rise
