"""Links that bodies can have: those whose pseudo-inertia is positive definite.

    P = [[Sigma, m c], [(m c)^T, m]] ,     Sigma = tr(I) / 2 - I

(Wensing, Kim and Slotine, IEEE Robotics and Automation Letters 3, 2018). Where an estimate is not, the
nearest one in the metric of its information is a cone program.
"""

from __future__ import annotations

import numpy as np

from calib.arrays import Array, IntArray
from calib.errors import CalibError
from calib.motion.regressor import PER_LINK, TENSOR

_LEAST = 1e-6  # eigenvalue of a pseudo-inertia in plausible sizes: thinner is no body


def pseudo_inertias(links: Array) -> Array:
    """Of inertial parameters (n, 10), shape (n, 4, 4)."""
    P = np.zeros((len(links), 4, 4))
    for p, (i, j) in enumerate(TENSOR):
        P[:, i, j] = P[:, j, i] = -links[:, 4 + p]
    P[:, range(3), range(3)] += 0.5 * links[:, [4, 7, 9]].sum(axis=1)[:, None]
    P[:, 3, :3] = P[:, :3, 3] = links[:, 1:4]
    P[:, 3, 3] = links[:, 0]
    return P


def physical(links: Array, sizes: Array, x: Array, information: Array, free: IntArray) -> Array:
    """Changes (10 n,) in plausible sizes, nearest to the estimate x, that leave every link a body.

    links : ndarray, shape (n, 10), as the robot's file has them; sizes : ndarray, shape (10 n,)
    information : ndarray, shape (f, f), of the last f, which were estimated
    free : places among these that may change, of whole links; the others stay at zero

    Raises CalibError where the solver finds none.
    """
    changed, own, moved = (
        np.zeros_like(x),
        free - (len(x) - len(information)),
        free[::PER_LINK] // 10,
    )
    H, pull = information[np.ix_(own, own)], (information @ x[len(x) - len(information) :])[own]
    changed[free] = np.linalg.solve(H, pull)
    if len(moved):
        links, sizes = links[moved], sizes[free].reshape(-1, PER_LINK)
        found = links + sizes * changed[free].reshape(-1, PER_LINK)
        if np.linalg.eigvalsh(_scaled(pseudo_inertias(found), sizes)).min() < _LEAST:
            changed[free] = _nearest(links, sizes, H, pull)
    return changed


def _scaled(P: Array, sizes: Array) -> Array:
    """Pseudo-inertias (n, 4, 4) by the plausible sizes (n, 10) of their masses and lengths."""
    unit = np.repeat(1.0 / np.sqrt(sizes[:, :1]), 4, axis=1)
    unit[:, :3] *= sizes[:, :1] / sizes[:, 1:2]
    return np.asarray(unit[:, :, None] * P * unit[:, None, :])


def _nearest(links: Array, sizes: Array, H: Array, pull: Array) -> Array:
    """``min x^T H x / 2 - pull^T x`` over what leaves links (k, 10) bodies, shape (10 k,)."""
    import clarabel
    from scipy.sparse import block_diag, csc_matrix

    columns, rows = np.tril_indices(4)  # the upper triangle, column by column, as the cone has it
    weight = np.where(rows == columns, 1.0, np.sqrt(2.0))
    units = [  # of each parameter; symmetric, so that rows of P are its columns
        _scaled(pseudo_inertias(np.diag(own)), np.tile(own, (PER_LINK, 1)))[:, rows, columns]
        * weight
        for own in sizes
    ]
    inside = _scaled(pseudo_inertias(links), sizes) - 2.0 * _LEAST * np.eye(4)
    scale, settings = float(np.diag(H).max()), clarabel.DefaultSettings()
    settings.verbose = False
    solution = clarabel.DefaultSolver(
        csc_matrix(np.triu(H) / scale), -pull / scale, csc_matrix(block_diag([-u.T for u in units])),
        (inside[:, rows, columns] * weight).ravel(), [clarabel.PSDTriangleConeT(4)] * len(links),
        settings,
    ).solve()  # fmt: skip
    if str(solution.status) not in ("Solved", "AlmostSolved"):
        raise CalibError(f"no links that bodies can have are near the estimate ({solution.status})")
    return np.array(solution.x)
