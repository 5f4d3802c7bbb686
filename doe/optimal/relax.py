"""The best weights over all candidates: a small program, priced over the whole pool.

Column generation. A master program over a few hundred candidates gives weights and with them M. The
supergradient at M scores every candidate of the pool in one product; those that would pay enter the
master, until the certified bound and the value agree. The master is an interior point method for the
smooth criteria, measured faster at every size, and a cone program for the others and where levels are
chosen; tests hold the one against the other. (Closest relative: Pillai, Ponte, Fampa, Lee, Singh and
Xie, arXiv 2411.01405, 2024.)
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from calib.arrays import Array, IntArray
from doe.optimal.allowed import Allowed
from doe.optimal.function import Selection

GAP = 1e-4
"""Certified gap, relative, at which the relaxation stops."""
_MOST_ROUNDS, _WARM_ROUNDS = 40, 3
_NEAR = 0.96  # share of the score that enters a plan, below which a candidate without weight leaves
_IDLE = 5e-3  # weight that is none: an interior point leaves a little everywhere
_DIGITS = 0.02  # precision of a master, of the gap that is left
_PATIENCE = 3  # rounds with neither a better bound nor a new candidate: the solver is at its end
_RANDOM = 20  # plans by chance that the method without cones begins with
_STEPS = 150  # of it
_LENGTHS = np.geomspace(0.5, 1e-3, 12)
_MOST_STEPS, _CENTRING, _TO_BOUNDARY = 80, 0.15, 0.98  # of the interior point method


@dataclass(frozen=True, eq=False)
class Relaxation:
    """Weights of the best weighted plan and the bound that they prove.

    index : ndarray of int, shape (q,), candidates; weights : ndarray, shape (q,)
    M : ndarray, shape (p, p); G : ndarray, shape (p, p), the supergradient of the bound
    value, bound : float, criterion at M and the proved upper bound over all plans
    rounds : int
    """

    index: IntArray
    weights: Array
    M: Array
    G: Array
    value: float
    bound: float
    rounds: int

    @property
    def support(self) -> IntArray:
        """Candidates with weight."""
        return self.index[self.weights > _IDLE]

    @property
    def gap(self) -> float:
        """Bound over value, less one."""
        return self.bound / self.value - 1.0


def relax(
    posed: Selection, *, start: Sequence[int] | IntArray = (), gap: float = GAP
) -> Relaxation:
    """Maximise the criterion over weights, certified over every candidate.

    start : further candidates to begin with, as those of a known plan
    It stops at a gap, or at a larger one where the solver cannot reach it.
    """
    criterion, allowed = posed.criterion, posed.allowed
    if not (criterion.smooth or criterion.conical):
        return _stepped(posed)
    active, M = _warm_start(posed, 1 if len(start) else _WARM_ROUNDS)
    active = np.union1d(active, np.asarray(start, dtype=int))
    precision, best, G_best, stalled = _DIGITS, np.inf, np.zeros_like(M), 0
    for rounds in range(1, _MOST_ROUNDS + 1):
        part = posed.take(active)
        weights, witness = _master(part, M, precision)
        M = part.blocks.total(np.arange(len(active)), weights)
        value = float(criterion.value(M))
        proofs = [criterion.gradient(M)] + ([] if witness is None else [witness])
        bound, G, scores = min((posed.proof(G) for G in proofs), key=lambda proof: proof[0])
        stalled = 0 if bound < best * (1.0 - 0.1 * GAP) else stalled + 1
        if bound < best:
            best, G_best = bound, G
        if best <= value * (1.0 + gap):
            break
        # No more digits of the master than its candidates deserve.
        precision = max(GAP / 4.0, min(precision, _DIGITS * (best / value - 1.0)))
        entering = _entering(scores, allowed)
        if np.isin(entering, active).all() and stalled >= _PATIENCE:
            break
        if rounds < _MOST_ROUNDS:
            near = scores[active] >= _NEAR * allowed.thresholds(scores)[allowed.group[active]]
            active = np.union1d(active[near | (weights > _IDLE)], entering)
    return Relaxation(active, weights, M, G_best, value, best, rounds)


def _stepped(posed: Selection) -> Relaxation:
    """Weights by steps towards the best whole plan of the gradient (Frank and Wolfe, 1956).

    For criteria without a cone form: it takes seconds, and proves less.
    """
    criterion, blocks, allowed = posed.criterion, posed.blocks, posed.allowed
    w, best, G_best = np.zeros(len(posed)), np.inf, np.eye(0)
    rng = np.random.default_rng(0)
    for _ in range(_RANDOM):
        np.add.at(w, allowed.best(rng.random(len(posed)))[1], 1.0 / _RANDOM)
    M = blocks.total(np.flatnonzero(w), w[w > 0.0])
    for _ in range(_STEPS):
        G = criterion.gradient(M)
        total, chosen = allowed.best(blocks.scores(G))
        bound = float((G * blocks.fixed).sum()) + total
        if bound < best:
            best, G_best = bound, G
        trials = M + _LENGTHS[:, None, None] * (blocks.total(chosen) - M)
        longest = int(criterion.value(trials).argmax())
        w *= 1.0 - _LENGTHS[longest]
        np.add.at(w, chosen, _LENGTHS[longest])
        M = trials[longest]
    index = np.flatnonzero(w)
    return Relaxation(index, w[index], M, G_best, float(criterion.value(M)), best, _STEPS)


def bounded(posed: Selection, relaxed: Relaxation) -> Relaxation:
    """The weights of a criterion with value and bound of another that is nearly the same.

    Relaxed anew where the bound there is loose by more than the gap.
    """
    G, value = posed.criterion.gradient(relaxed.M), float(posed.criterion.value(relaxed.M))
    at_hand = replace(relaxed, G=G, value=value, bound=posed.bound(G))
    if at_hand.gap <= 2.0 * max(relaxed.gap, GAP):
        return at_hand
    return min(relax(posed, start=relaxed.support), at_hand, key=lambda one: one.bound)


def _master(part: Selection, M: Array, precision: float) -> tuple[Array, Array | None]:
    """Weights of all candidates, and a supergradient from the dual where there is one.

    M : ndarray, shape (p, p), information so far: its best plan stands in where the solver fails
    """
    if part.criterion.smooth and not part.allowed.chooses_levels:
        # A singular step, on problems at the edge of rank: the cone program may still do.
        with suppress(np.linalg.LinAlgError):
            return newton_weights(part, precision), None
    solved = conic_weights(part)
    if solved is not None:
        return solved
    _, chosen = part.allowed.best(part.blocks.scores(part.criterion.gradient(M)))
    return np.bincount(chosen, minlength=len(part)).astype(float), None


def _warm_start(posed: Selection, rounds: int) -> tuple[IntArray, Array]:
    """Candidates and information of so many Frank-Wolfe steps from uniform weights."""
    blocks, allowed, active = posed.blocks, posed.allowed, np.zeros(0, dtype=int)
    M = blocks.fixed + allowed.size * blocks.mean
    for step in range(rounds):
        scores = blocks.scores(posed.criterion.gradient(M))
        _, chosen = allowed.best(scores)
        active = np.union1d(active, np.union1d(chosen, _entering(scores, allowed)))
        M = M + (blocks.total(chosen) - M) * (2.0 / (step + 3.0))
    return active, M


def _entering(scores: Array, allowed: Allowed) -> IntArray:
    """Best candidates of every level, and somewhat more of them than a plan takes."""
    spare, counts = max(2, 60 // len(allowed.positions)), allowed.counts
    return allowed.leading(scores, np.where(counts > 0, counts + spare, 0))


def newton_weights(posed: Selection, precision: float) -> Array:
    """Weights w of all candidates, shape (q,), that maximise the criterion; levels are given.

    precision : float, duality gap at which to stop, relative
    """
    from scipy.linalg import cho_factor, cho_solve

    criterion, blocks, allowed = posed.criterion, posed.blocks, posed.allowed
    q = len(blocks)
    present, group = np.unique(allowed.group, return_inverse=True)
    sums = (group == np.arange(len(present))[:, None]).astype(float)
    target = allowed.counts[present].astype(float)
    columns = blocks.matrices(np.arange(q))
    w: Array = (target / sums.sum(axis=1))[group]
    # Strictly inside even where a level has just as many candidates as it needs.
    upper = np.maximum(target[group] if allowed.repeats else 1.0, w * (1.0 + 1e-9)) + 1e-12
    slack = upper - w  # followed by itself: the difference loses its digits where w meets the bound
    y = np.zeros(len(present))
    lower_dual = upper_dual = np.full(q, len(blocks.fixed) / (2.0 * q))
    for _ in range(_MOST_STEPS):
        slope, rows = criterion.curvature(blocks.total(np.arange(q), w), columns)
        gap = float(w @ lower_dual + slack @ upper_dual)
        residual = slope + sums.T @ y - lower_dual + upper_dual
        loose = np.abs(residual).max() * target.sum()  # what the bound may lose by it
        if max(gap, loose) < precision * abs(slope @ w):
            break
        centre = _CENTRING * gap / (2.0 * q)
        H = rows @ rows.T
        H[np.diag_indices(q)] += lower_dual / w + upper_dual / slack
        right = -(slope + sums.T @ y) + centre / w - centre / slack
        factor = cho_factor(H, check_finite=False)
        solved = cho_solve(factor, np.column_stack([right, sums.T]), check_finite=False)
        dy = np.linalg.solve(sums @ solved[:, 1:], sums @ solved[:, 0] - (target - sums @ w))
        dw = solved[:, 0] - solved[:, 1:] @ dy
        d_lower = (centre - lower_dual * dw) / w - lower_dual
        d_upper = (centre + upper_dual * dw) / slack - upper_dual
        step = min(_longest(w, dw), _longest(slack, -dw))
        dual_step = min(_longest(lower_dual, d_lower), _longest(upper_dual, d_upper))
        w, slack, y = w + step * dw, slack - step * dw, y + dual_step * dy
        lower_dual, upper_dual = lower_dual + dual_step * d_lower, upper_dual + dual_step * d_upper
    return np.asarray(w)


def _longest(x: Array, dx: Array) -> float:
    """Step that stays inside x > 0."""
    falling = dx < 0.0
    return min(1.0, _TO_BOUNDARY * float((-x[falling] / dx[falling]).min(initial=np.inf)))


def conic_weights(posed: Selection) -> tuple[Array, Array | None] | None:
    """Weights of all candidates, shape (q,), and a supergradient from the dual where there is one.

    Returns None where the solver fails.
    """
    import cvxpy as cp

    blocks, allowed = posed.blocks, posed.allowed
    q, p = len(blocks), len(blocks.fixed)
    w = cp.Variable(q)
    columns = blocks.matrices(np.arange(q)).reshape(q, p * p).T
    M = cp.reshape(columns @ w + blocks.fixed.reshape(-1), (p, p), order="F") / allowed.size
    program = posed.criterion.conic(M)
    problem = cp.Problem(
        cp.Maximize(program.objective), [*_polytope(w, allowed), *program.constraints]
    )
    with warnings.catch_warnings(), suppress(cp.SolverError):
        # "may be inaccurate": the certificate does not rest on the solver.
        warnings.simplefilter("ignore")
        problem.solve(solver=cp.CLARABEL)
    if w.value is None or not np.isfinite(w.value).all():
        return None
    witness = None
    with suppress(TypeError, ValueError):  # no duals
        witness = None if program.witness is None else program.witness()
    return np.maximum(w.value, 0.0), witness


def _polytope(w: Any, allowed: Allowed) -> list[Any]:
    """Weighted plans: their convex hull."""
    import cvxpy as cp

    levels = len(allowed.positions)
    sums = (allowed.group == np.arange(levels)[:, None]).astype(float)
    if not allowed.chooses_levels:
        bounds = [w >= 0, sums @ w == allowed.counts]
        return bounds if allowed.repeats else [*bounds, w <= 1]
    z, away = cp.Variable(levels), allowed.positions - allowed.positions[:, None]
    close = (away >= 0.0) & (away < allowed.separation - 1e-12)
    constraints = [w >= 0, z >= 0, z <= 1, cp.sum(z) == allowed.used]
    constraints.append(sums @ w == cp.multiply(allowed.counts, z))
    constraints.append(np.maximum(close, np.eye(levels)) @ z <= 1)
    return constraints if allowed.repeats else [*constraints, w <= sums.T @ z]
