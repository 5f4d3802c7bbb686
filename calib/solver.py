"""Levenberg-Marquardt on many independent problems at once.

SciPy's ``least_squares`` solves one problem a call; Monte Carlo studies need a thousand small ones,
and array operations over all of them are seven to fifty times faster than a loop.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, Mask

Linearise = Callable[[Array], tuple[Array, Array]]
"""values (..., p) -> residuals (..., N) and their derivatives (..., N, p)."""

FIRST_DAMPING = 1e-7
"""Damping of the first step, relative to the diagonal."""
_DAMPING = (1e-12, 1e12)  # smallest, largest
_GROWTH = 2.0  # of the damping after a step that fails, and of this factor after each further one
_EASED = 0.1  # smallest factor of the damping after a step that helps
_LIGHT = 1e-3  # damping up to which a short step means a minimum
# Converged when a step moves no combination by this share of its deviation: below, the cost's own
# rounding decides, and a last Gauss-Newton step is better than its length by far.
_STEP = 1e-3
_WALL = 1e3  # damping from which a step to where nothing can be computed means that there it ends
_ROUNDING = 2.0**-52  # share of the cost below which no gain shows
_MAX_ITERATIONS = 60
_STACK, _STACKS = 256, 16  # rows, and how many times as many at once
_ROUNDED = 1e-13  # share of a variance that rounding takes or gives
_SMALL, _MANY = 12, 60  # matrices whose factors are found all at once


@dataclass(frozen=True, eq=False)
class Minimum:
    """Where a least-squares search ended.

    values : ndarray, shape (..., p)
    cost : ndarray, shape (...), sum of squared residuals
    converged : ndarray of bool, shape (...)
    iterations : int
    """

    values: Array
    cost: Array
    converged: Mask
    iterations: int


def normal_equations(r: Array, J: Array) -> tuple[Array, Array, Array]:
    """Cost (...), gradient ``J^T r`` (..., p) and Gauss-Newton matrix ``J^T J`` (..., p, p)."""
    Jt = np.swapaxes(J, -1, -2)
    return np.sum(r**2, axis=-1), (Jt @ r[..., None])[..., 0], Jt @ J


def damped_step(A: Array, g: Array, damping: Array) -> Array:
    """Solve ``(A + damping diag(A)) step = g`` with the columns scaled to one."""
    scale = np.sqrt(np.diagonal(A, axis1=-2, axis2=-1))
    scale = np.where(scale == 0.0, 1.0, scale)
    scaled = A / (scale[..., :, None] * scale[..., None, :])
    eye = np.eye(A.shape[-1])
    step = np.linalg.solve(scaled + damping[..., None, None] * eye, (g / scale)[..., None])
    out: Array = step[..., 0] / scale
    return out


def triangle(A: Array) -> Array:
    """R of ``A = Q R``, of shape (N, k) with N at least k: the triangle (k, k) of all rows.

    In stacks that the processor's cache holds, and of their triangles again: of long matrices several
    times faster (Demmel, Grigori, Hoemmen, Langou, SIAM J. Sci. Comput. 34(1), 2012).
    """
    while A.shape[0] >= 2 * _STACK and 0 < A.shape[1] < _STACK // 2:
        k, cut = A.shape[1], A.shape[0] // _STACK * _STACK
        parts = np.split(A[:cut].reshape(-1, _STACK, k), range(_STACKS, cut // _STACK, _STACKS))
        found = [np.asarray(np.linalg.qr(part, mode="r")).reshape(-1, k) for part in parts]
        A = np.concatenate([*found, A[cut:]])
    return np.asarray(np.linalg.qr(A, mode="r"))


def condensed(A: Array) -> Array:
    """As few rows as (N, k) have columns, whose products ``A^T A`` are the same."""
    return triangle(A) if A.shape[0] > A.shape[1] else A


def inverse_factor(V: Array) -> Array:
    """Lower L with ``L V L^T = I`` of positive definite matrices (..., d, d).

    Many small ones column by column, all at once: twice as fast as a call for each.
    Raises LinAlgError where one is not positive definite, rounding aside.
    """
    V = V + _ROUNDED * np.einsum("...ii->...i", V)[..., None] * np.eye(V.shape[-1])
    if not 0 < V.shape[-1] <= _SMALL or V[..., 0, 0].size < _MANY:
        return np.asarray(np.linalg.inv(np.linalg.cholesky(V)))
    A = np.moveaxis(V, (-2, -1), (0, 1)).copy()
    L = np.zeros_like(A)
    for k in range(len(A)):
        if (A[k, k] <= 0.0).any():
            raise np.linalg.LinAlgError("not positive definite")
        root = np.sqrt(A[k, k])
        L[k, k] = 1.0
        L[k, : k + 1] /= root
        below = A[k + 1 :, k] / root
        A[k + 1 :, k + 1 :] -= below[:, None] * below
        L[k + 1 :, : k + 1] -= below[:, None] * L[k, : k + 1]
    return np.ascontiguousarray(np.moveaxis(L, (0, 1), (-2, -1)))


def least_squares(r: Array, J: Array) -> Array:
    """Values (k,) that minimise ``|r - J v|^2``, r (N,), J (N, k); twice, for squares lose digits."""
    _, g, A = normal_equations(r, J)
    values = damped_step(A, g, np.array(_DAMPING[0]))
    return values + damped_step(A, J.T @ (r - J @ values), np.array(_DAMPING[0]))


def _eased(cost: Array, reached: Array, promised: Array) -> Array:
    """Factor of the damping after a step that helps, by how much of the promised gain it kept.

    A curved valley is followed at the damping that suits it, where fixed factors overshoot and return
    (Nielsen, IMM-REP-1999-05, Technical University of Denmark).
    """
    with np.errstate(all="ignore"):  # where nothing can be computed the step does not count
        kept = np.where(promised > 0.0, (cost - reached) / promised, 1.0)
        return np.asarray(np.clip(1.0 - (2.0 * kept - 1.0) ** 3, _EASED, _GROWTH))


def levenberg_marquardt(
    linearise: Linearise,
    start: Array,
    span: Array,
    max_iterations: int = _MAX_ITERATIONS,
    first_damping: float = FIRST_DAMPING,
) -> Minimum:
    """Minimise ``|r(values)|^2`` from ``start`` in the directions of ``span``.

    linearise : r are residuals measured minus predicted, J the derivative of the prediction
    start : ndarray, shape (..., p)
    span : ndarray, shape (p, k), directions in which values may move
    first_damping : float, of the first step, relative to the diagonal
    """
    values = np.array(start, dtype=float)
    batch = values.shape[:-1]
    if span.shape[1] == 0:
        r, _ = linearise(values)
        return Minimum(values, np.sum(r**2, axis=-1), np.ones(batch, dtype=bool), 0)

    everything = np.array_equal(span, np.eye(len(span)))

    def equations(v: Array) -> tuple[Array, Array, Array]:
        r, J = linearise(v)
        return normal_equations(r, J if everything else J @ span)

    cost, g, A = equations(values)
    damping, growth = np.full(batch, first_damping), np.full(batch, _GROWTH)
    converged, stalled, iterations = np.zeros(batch, dtype=bool), ~np.isfinite(cost), 0
    while iterations < max_iterations and not (converged | stalled).all():
        iterations += 1
        step = damped_step(A, g, damping)
        trial = values + step @ span.T
        with np.errstate(all="ignore"):  # where nothing can be computed no step is taken
            trial_cost, trial_g, trial_A = equations(trial)
        expected = np.einsum("...i,...i->...", step, g)  # squared length of the step in sigmas
        better = trial_cost <= cost
        least = _STEP**2 * np.maximum(1.0, cost / max(1, span.shape[1]))
        small = (damping <= _LIGHT) & (expected <= least)
        # A step below resolution ends the search even where rounding hides its gain.
        take = (better | small) & ~converged & ~stalled & np.isfinite(trial_cost)
        promised = expected + damping * np.einsum("...ii,...i,...i->...", A, step, step)
        lost = (promised <= _ROUNDING * cost) & (trial_cost >= cost)
        factor = np.where(take, _eased(cost, trial_cost, promised), growth)
        damping = np.clip(damping * factor, *_DAMPING)
        growth = np.where(take, _GROWTH, _GROWTH * growth)
        values, g = (np.where(take[..., None], a, b) for a, b in ((trial, values), (trial_g, g)))
        cost, A = np.where(take, trial_cost, cost), np.where(take[..., None, None], trial_A, A)
        converged = converged | small
        # No step helps, for the derivative is wrong here, or nothing can be computed beyond.
        wall = ~np.isfinite(trial_cost) & (damping >= _WALL)
        stalled = stalled | lost | wall | (damping >= _DAMPING[1])
    return Minimum(values, cost, converged, iterations)
