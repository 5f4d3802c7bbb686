"""Poses that stand alone: how much more the model may err there than among other poses.

Beyond all other poses a model is extrapolated, and what it lacks counts for more than noise: parameters
took up the error of the others, and not that of the one. How much more the others tell themselves. At
either end of each joint the outermost pose is predicted by those alone that are as far from it as the
pose that stands alone is from all. Where poses are too few for so far, the error is taken to grow in
proportion to the distance, and its square with the square.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, IntArray, Mask
from calib.identification.common import beyond
from calib.poses import Poses

_MOST = 1.0 / 3.0  # of the configurations, that are left out at an end
_WIDER = 1.5  # times the widest gap among the others
_FREE = 1e-3  # of a direction that the others must still tell
_RANK = 1e-9
_STANDS_OUT = 3.0  # times the mean square of a usual pose, below which none is an outlier


@dataclass(frozen=True, eq=False)
class _Others:
    """A fit to some poses: residuals y (m, R), basis Q (m, R, k), of all poses, zero where they take no
    part; rows (m,), how many numbers each has.
    """

    y: Array
    Q: Array
    rows: IntArray

    def missed(self, one: Mask, out: Mask) -> float | None:
        """Mean square over its variance of what the poses ``one`` miss by, fitted without ``out``.

        None where the others do not tell them.
        """
        k = self.Q.shape[-1]
        F, own = self.Q[out].reshape(-1, k), self.Q[one].reshape(-1, k)
        rest = np.eye(k) - F.T @ F
        if np.linalg.eigvalsh(rest).min(initial=1.0) < _FREE:
            return None
        off = self.y[one].ravel() + own @ np.linalg.solve(rest, F.T @ self.y[out].ravel())
        told = own.T @ off  # by Woodbury: a pose may have been read ten thousand times
        square = float(off @ off - told @ np.linalg.solve(rest + own.T @ own, told))
        return square / max(1, int(self.rows[one].sum()))


def lack_alone(
    poses: Poses,
    r: Array,
    J: Array,
    kept: Mask,
    span: Array,
    known: tuple[Array, Array],
    statistics: Array,
) -> Array:
    """How many times larger the mean square of a pose may be because it stands alone, shape (m,).

    One for all that do not.

    r : ndarray, shape (m, rows), whitened; J : ndarray, shape (m, rows, p)
    kept : ndarray of bool, shape (m,), poses that were fitted
    span : ndarray, shape (p, k), directions that were estimated
    known : residuals (h,) and derivatives (h, p) of what is known beside the poses
    statistics : ndarray, shape (m,), as of ``pose_statistics``; only who stands out is asked
    """
    found = np.ones(len(poses))
    counted = J.any(axis=(1, 2))
    typical = float(np.median(statistics[kept & counted]))
    for one, far in _alone(poses):
        others = kept & ~one & counted
        if others.sum() < 2 or statistics[one].max() <= _STANDS_OUT * typical or typical <= 0.0:
            continue
        fit = _fitted(r, J, others, span, known)
        more = [
            max(0.0, square / typical - 1.0) * max(1.0, far / reached) ** 2
            for end, out, reached in _ends(poses, others, far)
            if (square := fit.missed(end, out)) is not None
        ]
        found[one] = 1.0 + (float(np.mean(more)) if more else np.inf)
    return found


def _alone(poses: Poses) -> Iterator[tuple[Mask, float]]:
    """Readings of each configuration that lies far beyond all others, and how far, in their ranges.

    Farther, too, than any of the others from the next one: the end of a grid is not alone.
    """
    _, first = np.unique(poses.configuration, return_index=True)
    far: dict[int, float] = {}
    for values in poses.q[first].T:
        for i, gap in beyond(values).items():
            others = np.sort(np.delete(values, i))
            if gap > _WIDER * np.diff(others).max():
                # Where the others hold the joint still, as far as their range could be wide.
                reached = float(others[-1] - others[0]) or gap
                far[i] = max(far.get(i, 0.0), gap / reached)
    for i, share in far.items():
        yield poses.configuration == i, share


def _fitted(r: Array, J: Array, others: Mask, span: Array, known: tuple[Array, Array]) -> _Others:
    m, rows = r.shape
    A = np.concatenate([(J[others] @ span).reshape(-1, span.shape[1]), known[1] @ span])
    U, s, _ = np.linalg.svd(A / np.maximum(np.linalg.norm(A, axis=0), 1e-300), full_matrices=False)
    U = U[:, s > _RANK * s.max(initial=0.0)]
    y = np.concatenate([r[others].ravel(), known[0]])
    y = y - U @ (U.T @ y)
    count = int(others.sum()) * rows
    left, Q = np.zeros((m, rows)), np.zeros((m, rows, U.shape[1]))
    left[others] = y[:count].reshape(-1, rows)
    Q[others] = U[:count].reshape(-1, rows, U.shape[1])
    return _Others(left, Q, np.abs(J).any(axis=-1).sum(axis=-1))


def _ends(poses: Poses, others: Mask, far: float) -> Iterator[tuple[Mask, Mask, float]]:
    """The outermost configuration at either end of each joint, what lies near it, and what does not.

    far : float, how near, in ranges of the joint. Yields two masks (m,), and how far the rest is.
    """
    configuration = np.where(others, poses.configuration, -1)
    each, first = np.unique(configuration, return_index=True)
    each, first = each[each >= 0], first[each >= 0]
    most = max(1, int(_MOST * len(each)))
    for values in poses.q[first].T:
        reach = float(np.ptp(values))
        for way in (values, -values) if reach > 0.0 else ():
            order = np.argsort(-way, kind="stable")
            distance = (way[order[0]] - way[order]) / reach
            near = min(most, int((distance < far).sum()))
            if near < len(order) and distance[near] > 0.0:  # else a third of them share one value
                out = np.isin(configuration, each[order[:near]])
                yield configuration == each[order[0]], out, float(distance[near])
