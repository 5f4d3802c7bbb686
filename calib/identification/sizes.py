"""How large errors are by the readings of a fit."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calib.arrays import Array
from calib.model import Model
from calib.population.sizes import Elementary, Widths, widths_of

if TYPE_CHECKING:
    from calib.identification.fitted import Fitted

_RANK = 1e-9  # share of a column that others leave, below which it is one of them


def widths_by(fit: Fitted, of: Elementary, known: Model) -> Widths:
    """How large the errors are by the readings of a fit, the noise as it found that.

    known : Model, without sizes: what it knows beside the readings counts as they do
    """
    y, J = _independent(fit, known)
    rest = np.delete(J, of.at, axis=1)
    Q = _basis(rest)
    used = int(np.count_nonzero(np.abs(J).any(axis=1)))
    own = J[:, of.at]
    y, own = y - Q @ (Q.T @ y), own - Q @ (Q.T @ own)
    return widths_of(of, own, y, used - Q.shape[1])


def _independent(fit: Fitted, known: Model) -> tuple[Array, Array]:
    """Independent rows of unit variance: readings less the nominal arm's (N,), derivatives (N, p)."""
    observation, values = fit.counted, fit.values
    r, J = observation.whitened(values)
    if observation.mixing is None:
        factor = fit.noise.divisor
        r, J = r / factor, J / factor
    else:
        r, J = observation.mixing(r[..., None])[..., 0], observation.mixing(J)
    off, beside = known.beside(values)
    r, J = np.append(r, off), np.concatenate([J.reshape(-1, J.shape[-1]), beside])
    return r + J @ values, J


def _basis(columns: Array) -> Array:
    """Orthonormal directions of columns (N, k), shape (N, rank)."""
    from scipy.linalg import qr

    scale = np.linalg.norm(columns, axis=0)
    columns = columns[:, scale > 0.0] / scale[scale > 0.0]
    if not columns.shape[1]:
        return np.zeros((len(columns), 0))
    Q, R, _ = qr(columns, mode="economic", pivoting=True)
    pivots = np.abs(np.diag(R))
    return np.asarray(Q[:, pivots > _RANK * pivots.max(initial=0.0)])
