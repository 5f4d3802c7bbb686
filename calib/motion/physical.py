"""Links as bodies can be: inertials that some distribution of mass has.

Those are the ones whose pseudo-inertia

    P = [[Sigma, m c], [(m c)^T, m]] ,     Sigma = tr(I) / 2 - I

is positive definite (Wensing, Kim and Slotine, IEEE Robotics and Automation Letters 3, 2018). Where the
free estimate is not, the nearest one that is, in the metric of the information, is a cone program.
"""

from __future__ import annotations

import numpy as np

from calib.arrays import Array, IntArray
from calib.errors import CalibError
from calib.motion.regressor import PER_LINK, TENSOR

_LEAST = 1e-6  # eigenvalue of a pseudo-inertia, in plausible sizes: thinner is no body


def pseudo_inertias(links: Array) -> Array:
    """Of inertial parameters (n, 10), shape (n, 4, 4)."""
    P, inertia = np.zeros((len(links), 4, 4)), np.zeros((len(links), 3, 3))
    for p, (i, j) in enumerate(TENSOR):
        inertia[:, i, j] = inertia[:, j, i] = links[:, 4 + p]
    P[:, :3, :3] = 0.5 * np.trace(inertia, axis1=1, axis2=2)[:, None, None] * np.eye(3) - inertia
    P[:, 3, :3] = P[:, :3, 3] = links[:, 1:4]
    P[:, 3, 3] = links[:, 0]
    return P


def physical(links: Array, sizes: Array, x: Array, information: Array, free: IntArray) -> Array:
    """Changes (10 n,) in plausible sizes, nearest to the estimate x, that make every link a body.

    links : ndarray, shape (n, 10), as the robot's file has them; sizes : ndarray, shape (10 n,)
    information : ndarray, shape (f, f), of all that were estimated, the last ones
    free : places of those that may change; the others stay at zero

    Raises CalibError where the solver finds none.
    """
    estimated, changed = np.arange(len(x) - len(information), len(x)), np.zeros_like(x)
    own = np.isin(estimated, free)
    H, pull = information[np.ix_(own, own)], (information @ x[estimated])[own]
    changed[estimated[own]] = np.linalg.solve(H, pull)
    moved = np.unique(estimated[own] // PER_LINK)
    small = _scaled(pseudo_inertias(links + (sizes * changed).reshape(links.shape)), sizes)[moved]
    if len(moved) and np.linalg.eigvalsh(small).min() < _LEAST:
        changed[estimated[own]] = _nearest(links[moved], sizes, moved, H, pull)
    return changed


def _scaled(P: Array, sizes: Array) -> Array:
    """Pseudo-inertias (n, 4, 4) in plausible sizes of their links' mass and length."""
    mass, length = sizes[::PER_LINK], sizes[1::PER_LINK] / sizes[::PER_LINK]
    unit = np.stack([1.0 / length] * 3 + [np.ones(len(mass))], axis=1) / np.sqrt(mass)[:, None]
    return np.asarray(unit[:, :, None] * P * unit[:, None, :])


def _nearest(links: Array, sizes: Array, moved: IntArray, H: Array, pull: Array) -> Array:
    """``min x^T H x / 2 - pull^T x`` over what makes the links bodies, shape (10 k,)."""
    import clarabel
    from scipy.sparse import block_diag, csc_matrix, triu

    own = sizes.reshape(-1, PER_LINK)[moved]
    rows, columns = np.array([(i, j) for j in range(4) for i in range(j + 1)]).T
    weight = np.where(rows == columns, 1.0, np.sqrt(2.0))  # the cone's upper triangle

    def vectors(P: Array, k: int) -> Array:
        return np.asarray(_scaled(P, own[k])[:, rows, columns] * weight)

    units = [vectors(pseudo_inertias(np.diag(size)), k) for k, size in enumerate(own)]
    fixed = [vectors(pseudo_inertias(links[[k]]), k)[0] for k in range(len(links))]
    least = 2.0 * _LEAST * weight * (rows == columns)
    scale, settings = float(np.abs(np.diag(H)).max()), clarabel.DefaultSettings()
    settings.verbose = False
    solution = clarabel.DefaultSolver(
        csc_matrix(triu(H / scale)),
        -pull / scale,
        csc_matrix(block_diag([-own.T for own in units])),
        np.concatenate(fixed) - np.tile(least, len(links)),
        [clarabel.PSDTriangleConeT(4)] * len(links),
        settings,
    ).solve()
    if str(solution.status) not in ("Solved", "AlmostSolved"):
        raise CalibError(f"no inertials that a body can have are near the estimate ({solution.status})")
    return np.array(solution.x)
