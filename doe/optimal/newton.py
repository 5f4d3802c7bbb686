"""Weights by a primal-dual interior point method, for criteria with a curvature.

Where there are many parameters a cone program of ``p^2`` entries is slow. The smooth criteria have
gradients and Hessians in closed form, ``H = rows rows^T``, and the constraints are one sum a level
and bounds, so a Newton step is one Cholesky factorisation (Nocedal and Wright, Numerical
Optimization, 2006, chapter 19).
"""

from __future__ import annotations

import numpy as np

from calib.arrays import Array
from doe.optimal.allowed import Allowed
from doe.optimal.blocks import Blocks
from doe.optimal.function import InformationFunction

_MOST_STEPS = 80
_CENTRING = 0.15
_TO_BOUNDARY = 0.98


def newton_weights(
    criterion: InformationFunction, blocks: Blocks, allowed: Allowed, precision: float
) -> Array:
    """Weights w of all candidates, shape (q,), that maximise the criterion; levels are given.

    precision : float, duality gap at which to stop, relative
    """
    q = len(blocks)
    present, group = np.unique(allowed.group, return_inverse=True)
    sums = (group == np.arange(len(present))[:, None]).astype(float)
    target = allowed.counts[present].astype(float)
    top = target[group] if allowed.repeats else 1.0
    columns = blocks.matrices(np.arange(q))
    w: Array = (target / sums.sum(axis=1))[group]
    # Strictly inside even where a level has just as many candidates as it needs.
    upper = np.maximum(top, w * (1.0 + 1e-9)) + 1e-12
    slack = upper - w  # followed by itself: the difference loses its digits where w meets the bound
    y = np.zeros(len(present))
    lower_dual = upper_dual = np.full(q, len(blocks.fixed) / (2.0 * q))
    for _ in range(_MOST_STEPS):
        _, slope, rows = criterion.curvature(blocks.total(np.arange(q), w), columns)
        gap = float(w @ lower_dual + slack @ upper_dual)
        residual = slope + sums.T @ y - lower_dual + upper_dual
        loose = (
            np.abs(residual).max() * target.sum()
        )  # what the bound, a sum over a plan, may lose by it
        if max(gap, loose) < precision * abs(slope @ w):
            break
        centre = _CENTRING * gap / (2.0 * q)
        H = rows @ rows.T
        H[np.diag_indices(q)] += lower_dual / w + upper_dual / slack
        right = -(slope + sums.T @ y) + centre / w - centre / slack
        solved = _solve(H, np.column_stack([right, sums.T]))
        schur = sums @ solved[:, 1:]
        dy = np.linalg.solve(schur, sums @ solved[:, 0] - (target - sums @ w))
        dw = solved[:, 0] - solved[:, 1:] @ dy
        d_lower = (centre - lower_dual * dw) / w - lower_dual
        d_upper = (centre + upper_dual * dw) / slack - upper_dual
        step = min(_longest(w, dw), _longest(slack, -dw))
        dual_step = min(_longest(lower_dual, d_lower), _longest(upper_dual, d_upper))
        w, slack = w + step * dw, slack - step * dw
        y = y + dual_step * dy
        lower_dual, upper_dual = lower_dual + dual_step * d_lower, upper_dual + dual_step * d_upper
    return np.asarray(w)


def _solve(H: Array, right: Array) -> Array:
    from scipy.linalg import cho_factor, cho_solve

    return np.asarray(cho_solve(cho_factor(H, check_finite=False), right, check_finite=False))


def _longest(x: Array, dx: Array) -> float:
    """Step that stays inside x > 0."""
    falling = dx < 0.0
    if not falling.any():
        return 1.0
    return min(1.0, _TO_BOUNDARY * float((-x[falling] / dx[falling]).min()))
