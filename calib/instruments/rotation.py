"""The rotation of least squares whose nine entries stand in linear equations."""

from __future__ import annotations

import numpy as np

from calib.arm.se3 import nearest_rotation, skew, so3_exp, so3_exp_with_jacobian, so3_log
from calib.arrays import Array
from calib.solver import levenberg_marquardt

_STARTS = 256
_FOLLOWED = 12  # the best of them


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
