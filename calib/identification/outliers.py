"""Poses that do not belong, judged against what the other poses show.

Each pose has the mean square of its residual over its own predicted variance, leverage taken out. Where
the model is incomplete these follow no chi-square of the instrument's sigma, so scale and degrees of
freedom are taken from their own median and quartiles: an outlier lies beyond what the largest of m such
draws would reach once in a thousand data sets. In small sets the worst pose is tested against the fit
without it (F test), and one that was left out and agrees with the others is taken back first.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from calib.arrays import Array, Mask, in_parts, stacked
from calib.model.covariance import covariance
from calib.observations.linear import LinearProblem
from calib.poses import Measurements, Poses
from calib.solver import condensed

_ALPHA = 1e-3
_MOST = 0.12  # share of the poses that may be called outliers
_FEWEST = 12  # poses below which a wrong one cannot be told from a right one
_FEW = 30  # poses below which quartiles mean little and poses are tested one by one
_SINGULAR = 0.02  # directions in which a pose is fitted through itself say nothing


@dataclass(frozen=True, eq=False)
class Judgement:
    """Poses to keep, the statistic of every pose, both (m,), and its limit."""

    kept: Mask
    statistics: Array
    limit: float


def judged(data: Measurements, linear: LinearProblem, kept: Mask, rows: int, dof: int) -> Judgement:
    """What a fit to the poses kept, shape (m,), says of every pose.

    linear : LinearProblem, of all poses; rows : int, of each; dof : of the poses kept
    """
    statistics, counted = pose_statistics(linear, kept)
    statistics = statistics / extrapolation_factor(data.poses, linear, kept, statistics)
    if not _FEWEST <= len(kept) < _FEW:
        limit = threshold(statistics, rows)
        return Judgement(~judge(statistics, limit), statistics, limit)
    cost = float((linear.r[kept] ** 2).sum())
    share = _independent_share(data.in_place(linear.r).reshape(len(kept), -1)[kept])
    one = changed_pose(statistics, counted, kept, cost, dof, share)
    fresh = kept ^ (np.arange(len(kept)) == (-1 if one is None else one))
    return Judgement(fresh, statistics, float(statistics[fresh].max(initial=0.0)))


def pose_statistics(linear: LinearProblem, kept: Mask) -> tuple[Array, Array]:
    """Mean square of the residual of each pose over its predicted variance, and its rows, (m,) each.

    linear : LinearProblem, of all poses; kept : ndarray of bool, shape (m,), those that were fitted
    """
    J, held = linear.J, linear.prior_weight * linear.held
    rows = condensed(stacked(J if kept.all() else J[kept]))
    return fit_statistics(linear.r, J, kept, covariance(np.concatenate([rows, held]), linear.span))


def fit_statistics(r: Array, J: Array, fitted: Mask, cov: Array) -> tuple[Array, Array]:
    """The same for a fit with covariance (p, p) to the poses ``fitted``, shape (m,).

    A fitted pose scatters by ``I - J cov J^T``, another one by ``I + J cov J^T``. What lies across the
    columns of J scatters as it does by itself; of few rows nothing does.
    """
    parts = in_parts(len(J), math.prod(J.shape[1:]))
    if len(parts) > 1:
        each = [fit_statistics(r[part], J[part], fitted[part], cov) for part in parts]
        return np.concatenate([s for s, _ in each]), np.concatenate([n for _, n in each])
    used = J.any(axis=-1)
    r = np.where(used, r, 0.0)
    rows, columns = J.shape[-2:]
    Q, R = np.linalg.qr(J) if rows > columns else (np.eye(rows), J)
    along = (np.swapaxes(Q, -1, -2) @ r[..., None])[..., 0]
    across = r - (Q @ along[..., None])[..., 0]
    sign = np.where(fitted, -1.0, 1.0)[:, None, None]
    own, axes = np.linalg.eigh(np.eye(R.shape[-2]) + sign * (R @ cov @ np.swapaxes(R, -1, -2)))
    component = (np.swapaxes(axes, -1, -2) @ along[..., None])[..., 0]
    known = own > _SINGULAR
    terms = np.where(known, component**2 / np.where(known, own, 1.0), 0.0)
    counted = used.sum(axis=-1) - (~known).sum(axis=-1)
    squares = (across**2).sum(axis=-1) + terms.sum(axis=-1)
    return squares / np.maximum(counted, 1), counted


def threshold(statistics: Array, rows: int) -> float:
    """Largest value of the statistic that still belongs to the rest; infinite for few poses.

    statistics : ndarray, shape (m,), mean squares of the poses; rows : int, behind each of them
    """
    from scipy.special import gammaincinv

    m = len(statistics)
    if m < _FEWEST:
        return float("inf")
    low, middle, high = np.quantile(statistics, (0.25, 0.5, 0.75))
    half = np.linspace(1.0, rows, 4 * rows) / 2.0
    ratios = gammaincinv(half, 0.75) / gammaincinv(half, 0.25)
    # Quartiles of few poses are uncertain: lean towards the longer tail.
    longer = 1.0 + 1.0 / np.sqrt(m)
    own = half[np.argmin(np.abs(ratios - high / max(low, 1e-300) * longer))]
    largest = gammaincinv(own, 1.0 - _ALPHA / m) / gammaincinv(own, 0.5)
    return float(middle * largest * longer)


def judge(statistics: Array, limit: float) -> Mask:
    """Which poses are outliers, shape (m,): beyond the limit, and at most 12 per cent of them."""
    out = np.zeros(len(statistics), dtype=bool)
    out[np.argsort(-statistics)[: int(_MOST * len(statistics))]] = True
    return out & (statistics > limit)


def changed_pose(
    statistics: Array, rows: Array, kept: Mask, cost: float, dof: int, share: float = 1.0
) -> int | None:
    """The pose of a small set that the fit judges otherwise than it was counted, None where none is.

    One that was left out and agrees with the fit without it comes back first; else the worst of the
    kept goes, if the fit without it says so. Of a pose without rows nothing says that it agrees.

    statistics, rows : ndarray, shape (m,), as of :func:`pose_statistics`: the product is what the cost
        falls by when a pose is left out
    kept : ndarray of bool, shape (m,); cost, dof : sum of their squares and its degrees of freedom
    share : of the numbers that err by themselves
    """
    from scipy.special import fdtrc

    m, out = len(kept), ~kept & (rows > 0)

    def by_chance(mean_square: float, k: int, rest: float, left: int) -> bool:
        F = mean_square * left / rest if rest > 1e-300 else np.inf
        return float(fdtrc(share * k, share * left, F)) >= _ALPHA / m

    if out.any() and dof > 0:
        best = int(np.where(out, statistics, np.inf).argmin())
        if by_chance(statistics[best], int(rows[best]), cost, dof):
            return best
    drop = np.where(kept, statistics * rows, 0.0)
    worst = int(drop.argmax())
    k, left = int(rows[worst]), dof - int(rows[worst])
    if m - int(kept.sum()) >= max(1, int(_MOST * m)) or not 0 < k <= left or not drop[worst]:
        return None
    rest = max(cost - drop[worst], np.finfo(float).eps * cost)
    return None if by_chance(drop[worst] / k, k, rest, left) else worst


def _independent_share(r: Array) -> float:
    """Share of a pose's numbers that err by themselves, by how they go together in residuals (m, R).

    A pose that errs as a whole has fewer errors than numbers, and as many degrees of freedom: those of
    the sum of squares of normal numbers with covariance S, ``(tr S)^2 / tr(S^2)`` (Satterthwaite), S
    from so few poses that 1 / m of its inverse is chance.
    """
    count, S = int(np.count_nonzero(r.any(axis=0))), r.T @ r
    together = float((S**2).sum()) / max(float(np.trace(S)) ** 2, 1e-300) - 1.0 / max(len(r), 1)
    return min(1.0, 1.0 / max(together * max(count, 1), 1e-12))


# -- poses that stand alone ----------------------------------------------------------------------

# Beyond all other poses a model is extrapolated, and what it lacks counts for more than noise. How much
# more the others tell: at either end of each joint the outermost pose is predicted by those alone that
# are as far from it. Where poses are too few for so far, the error grows in proportion to the distance.

_ALONE = 0.15  # of the range of the others: how far beyond them a pose is extrapolated
_WIDER = 1.5  # times the widest gap among the others
_MOST_LEFT_OUT = 1.0 / 3.0  # of the configurations, that are left out at an end
_FREE = 1e-3  # of a direction that the others must still tell
_STANDS_OUT = 3.0  # times the mean square of a usual pose, below which none is an outlier


def extrapolation_factor(
    poses: Poses, linear: LinearProblem, kept: Mask, statistics: Array
) -> Array:
    """How many times larger the mean square of a pose may be because it stands alone, shape (m,).

    One for all that do not. Arguments as of :func:`pose_statistics`, with its statistics, shape (m,).
    """
    factor, counted = np.ones(len(poses)), linear.J.any(axis=(1, 2))
    typical = float(np.median(statistics[kept & counted]))
    for one, far in _alone(poses):
        others = kept & ~one & counted
        if others.sum() < 2 or statistics[one].max() <= _STANDS_OUT * typical or typical <= 0.0:
            continue
        r, J = linear.r * others[:, None], linear.J * others[:, None, None]
        fit = replace(linear, r=r, J=J, mixing=None, weighing=None).complement.at_readings
        more = [
            max(0.0, square / linear.J[end].any(axis=-1).sum() / typical - 1.0)
            * max(1.0, far / reached) ** 2
            for end, out, reached in _ends(poses, others, far)
            if (square := _missed(*fit, end, out)) is not None
        ]
        factor[one] = 1.0 + (float(np.mean(more)) if more else np.inf)
    return factor


def _missed(y: Array, Q: Array, one: Mask, out: Mask) -> float | None:
    """Square over its variance of what the poses ``one`` miss by, fitted without ``out``, (m,) each.

    y, Q : residuals (m, R) and basis (m, R, k) of a fit, zero of poses without part
    None where the others do not tell them.
    """
    k = Q.shape[-1]
    F, rows = Q[out].reshape(-1, k), Q[one].reshape(-1, k)
    rest = np.eye(k) - F.T @ F
    if np.linalg.eigvalsh(rest).min(initial=1.0) < _FREE:
        return None
    off = y[one].ravel() + rows @ np.linalg.solve(rest, F.T @ y[out].ravel())
    along = rows.T @ off  # by Woodbury: a pose may have been read ten thousand times
    return float(off @ off - along @ np.linalg.solve(rest + rows.T @ rows, along))


def _alone(poses: Poses) -> Iterator[tuple[Mask, float]]:
    """Readings of each configuration that lies far beyond all others, and how far, in their ranges.

    Farther, too, than any of the others from the next one: the end of a grid is not alone.
    """
    each, first = np.unique(poses.configuration, return_index=True)
    far: dict[int, float] = {}
    for values in poses.q[first].T if len(first) > 3 else ():
        order = np.argsort(values, kind="stable")
        for end, *others in (order, order[::-1]):
            apart = np.abs(np.diff(values[others]))
            gap, reach = float(abs(values[others[0]] - values[end])), float(apart.sum())
            if gap > max(_ALONE * reach, _WIDER * float(apart.max())):
                # Where the others hold the joint still, as far as their range could be wide.
                far[end] = max(far.get(end, 0.0), gap / (reach or gap))
    for i, share in far.items():
        yield poses.configuration == each[i], share


def _ends(poses: Poses, others: Mask, far: float) -> Iterator[tuple[Mask, Mask, float]]:
    """The outermost configuration at either end of each joint, what lies near it, and how far not.

    far : float, how near, in ranges of the joint. Yields two masks (m,), and how far the rest is.
    """
    configuration = np.where(others, poses.configuration, -1)
    each, first = np.unique(configuration, return_index=True)
    each, first = each[each >= 0], first[each >= 0]
    most = max(1, int(_MOST_LEFT_OUT * len(each)))
    for values in poses.q[first].T:
        reach = float(np.ptp(values))
        for way in (values, -values) if reach > 0.0 else ():
            order = np.argsort(-way, kind="stable")
            distance = (way[order[0]] - way[order]) / reach
            near = min(most, int((distance < far).sum()))
            if near < len(order) and distance[near] > 0.0:  # else a third of them share one value
                out = np.isin(configuration, each[order[:near]])
                yield configuration == each[order[0]], out, float(distance[near])
