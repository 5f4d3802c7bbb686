"""Poses that do not belong, judged against what the other poses show.

In small sets the worst pose is tested against the fit without it (F test), again and again; one that
was left out and agrees with the fit to the others is taken back first.

Each pose gets the squared length of its residual in units of its own predicted spread, leverage
taken out. Where the model is incomplete these follow no chi-square of the instrument's sigma, so
scale and degrees of freedom are taken from their own median and quartiles; a pose is an outlier
when it lies beyond what the largest of m such draws would reach once in a thousand data sets.
"""

from __future__ import annotations

import math

import numpy as np

from calib.arrays import Array, Mask, in_parts, stacked
from calib.linear import LinearProblem
from calib.model.covariance import covariance
from calib.solver import condensed

_ALPHA = 1e-3
_MOST = 0.12  # share of the poses that may be called outliers
_FEWEST = 12  # poses below which a wrong one cannot be told from a right one
_FEW = 30  # poses below which quartiles mean little and poses are tested one by one
_SINGULAR = 0.02  # directions in which a pose is fitted through itself say nothing


def pose_statistics(linear: LinearProblem, kept: Mask) -> tuple[Array, Array]:
    """Mean square of the residual of each pose over its predicted variance, and its rows, (m,) each.

    linear : LinearProblem, of all poses; kept : ndarray of bool, shape (m,), those that were fitted
    """
    J, held = linear.J, linear.prior_weight * linear.held
    rows = condensed(stacked(J if kept.all() else J[kept]))
    cov = covariance(np.concatenate([rows, held]), linear.span)
    return fit_statistics(linear.r, J, kept, cov)


def fit_statistics(r: Array, J: Array, weight: Array | Mask, cov: Array) -> tuple[Array, Array]:
    """The same for a fit of weighted poses, and whatever else held it, with covariance (p, p).

    weight : ndarray, shape (m,), of their rows in the fit, one in full and zero for those without part

    A fitted pose scatters by ``I - J cov J^T``, another one by ``I + J cov J^T``, and one that counted
    less by ``I + (1 - 2 weight^2) J cov J^T``: a little less than that, as the poses that weigh less
    than their noise says owe less to it. What lies across the columns of J scatters as it does by
    itself; of few rows nothing does.
    """
    parts = in_parts(len(J), math.prod(J.shape[1:]))
    found = [_fit_statistics(r[own], J[own], weight[own], cov) for own in parts]
    statistics, counted = (np.concatenate(part) for part in zip(*found, strict=True))
    return statistics, counted


def _fit_statistics(r: Array, J: Array, weight: Array | Mask, cov: Array) -> tuple[Array, Array]:
    sign = 1.0 - 2.0 * np.square(weight, dtype=float)
    used = np.abs(J).sum(axis=-1) > 0.0
    r = np.where(used, r, 0.0)
    rows, columns = J.shape[-2:]
    Q, R = np.linalg.qr(J) if rows > columns else (np.eye(rows), J)
    own = (np.swapaxes(Q, -1, -2) @ r[..., None])[..., 0]
    shared = R @ cov @ np.swapaxes(R, -1, -2)
    eigenvalues, vectors = np.linalg.eigh(np.eye(R.shape[-2]) + sign[:, None, None] * shared)
    component = (np.swapaxes(vectors, -1, -2) @ own[..., None])[..., 0]
    informative = eigenvalues > _SINGULAR
    terms = np.where(informative, component**2 / np.where(informative, eigenvalues, 1.0), 0.0)
    across = r - (Q @ own[..., None])[..., 0]
    counted = used.sum(axis=-1) - (~informative).sum(axis=-1)
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
    dof = np.linspace(1.0, rows, 4 * rows)
    ratios = gammaincinv(dof / 2, 0.75) / gammaincinv(dof / 2, 0.25)
    # Quartiles of few poses are uncertain: lean towards the longer tail.
    widened = high / max(low, 1e-300) * (1.0 + 1.0 / np.sqrt(m))
    nu = float(dof[np.argmin(np.abs(ratios - widened))])
    largest = gammaincinv(nu / 2, 1.0 - _ALPHA / m) / gammaincinv(nu / 2, 0.5)
    return float(middle * largest * (1.0 + 1.0 / np.sqrt(m)))


def judge(statistics: Array, limit: float) -> Mask:
    """Which poses are outliers, shape (m,): beyond the limit, and at most 12 per cent of them."""
    most = int(_MOST * len(statistics))
    order = np.argsort(-statistics)
    out = np.zeros(len(statistics), dtype=bool)
    out[order[:most]] = True
    return out & (statistics > limit)


def small_set(poses: int) -> bool:
    """Whether poses are tested one by one."""
    return _FEWEST <= poses < _FEW


def independent_share(r: Array, kept: Mask) -> float:
    """Share of a pose's numbers that err by themselves, by how they go together over the kept poses.

    r : ndarray, shape (m, rows), residuals
    A pose that errs as a whole has fewer errors than numbers, and as many degrees of freedom: those of
    the sum of squares of normal numbers with covariance S, ``(tr S)^2 / tr(S^2)`` (Satterthwaite), S
    from so few poses that 1 / m of its inverse is chance.
    """
    own = r[kept]
    count = int(np.count_nonzero(own.any(axis=0)))
    S = own.T @ own
    together = float((S**2).sum()) / max(float(np.trace(S)) ** 2, 1e-300) - 1.0 / max(len(own), 1)
    return min(1.0, 1.0 / max(together * max(count, 1), 1e-12))


def next_outlier(
    statistics: Array, rows: Array, kept: Mask, cost: float, dof: int, share: float = 1.0
) -> int | None:
    """The worst of the kept poses of a small set, if the fit without it says so, else None.

    statistics, rows : ndarray, shape (m,), mean squares and numbers of rows of the poses, as of
        :func:`pose_statistics`: their product is what the cost falls by when a pose is left out
    kept : ndarray of bool, shape (m,), the poses that were fitted
    cost, dof : sum of squares of the kept poses and its degrees of freedom
    share : of the numbers that err by themselves
    """
    from scipy.special import fdtrc

    m = len(kept)
    if m - int(kept.sum()) >= max(1, int(_MOST * m)):
        return None
    drop = np.where(kept, statistics * rows, 0.0)
    worst = int(drop.argmax())
    k, left = int(rows[worst]), dof - int(rows[worst])
    if not 0 < k <= left:
        return None
    rest = max(cost - drop[worst], np.finfo(float).eps * cost)
    F = drop[worst] / k * left / rest if rest > 0.0 else 0.0
    return worst if float(fdtrc(share * k, share * left, F)) < _ALPHA / m else None


def wrongly_out(
    statistics: Array, rows: Array, kept: Mask, cost: float, dof: int, share: float = 1.0
) -> int | None:
    """The pose of a small set that was left out and agrees best with the fit without it, else None.

    The test of :func:`next_outlier`, the other way round; arguments, shapes (m,), as there. A pose
    without rows stays out: nothing says that it agrees.
    """
    from scipy.special import fdtrc

    out = ~kept & (rows > 0)
    if not out.any() or dof <= 0:
        return None
    best = int(np.where(out, statistics, np.inf).argmin())
    F = statistics[best] * dof / cost if cost > 1e-300 else np.inf
    k = share * int(rows[best])
    return best if float(fdtrc(k, share * dof, F)) >= _ALPHA / len(kept) else None
