"""Weights by a cone program: cvxpy states it, clarabel solves it."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np

from calib.arrays import Array
from doe.optimal.allowed import Allowed
from doe.optimal.blocks import Blocks
from doe.optimal.function import InformationFunction


def conic_weights(
    criterion: InformationFunction, blocks: Blocks, allowed: Allowed, at: Array
) -> tuple[Array, Array | None] | None:
    """Weights of all candidates, shape (q,), and a supergradient from the dual where there is one.

    at : ndarray, shape (R, p, p), information matrices met so far: criteria with many cones take those
        that count there
    Returns None where the solver fails.
    """
    import cvxpy as cp

    q, p = len(blocks), len(blocks.fixed)
    w = cp.Variable(q)
    columns = blocks.matrices(np.arange(q)).reshape(q, p * p).T
    M = cp.reshape(columns @ w + blocks.fixed.reshape(-1), (p, p), order="F") / allowed.size
    program = criterion.conic(M, at)
    constraints = [*_polytope(w, allowed), *program.constraints]
    problem = cp.Problem(cp.Maximize(program.objective), constraints)
    try:
        with warnings.catch_warnings():
            # "may be inaccurate": the certificate does not rest on the solver.
            warnings.simplefilter("ignore")
            problem.solve(solver=cp.CLARABEL)
    except cp.SolverError:
        return None
    if w.value is None or not np.isfinite(w.value).all():
        return None
    witness = None
    if program.witness is not None:
        try:
            witness = program.witness()
        except (TypeError, ValueError):  # no duals
            witness = None
    return np.maximum(w.value, 0.0), witness


def _polytope(w: Any, allowed: Allowed) -> list[Any]:
    """Weighted plans: their convex hull."""
    import cvxpy as cp

    levels = len(allowed.positions)
    sums = (allowed.group == np.arange(levels)[:, None]).astype(float)
    if not allowed.chooses_levels:
        bounds = [w >= 0, sums @ w == allowed.counts]
        return bounds if allowed.repeats else [*bounds, w <= 1]
    z = cp.Variable(levels)
    close = np.array(
        [
            (allowed.positions >= a) & (allowed.positions < a + allowed.separation - 1e-12)
            for a in allowed.positions
        ],
        dtype=float,
    )
    constraints = [w >= 0, z >= 0, z <= 1, cp.sum(z) == allowed.used]
    constraints.append(sums @ w == cp.multiply(allowed.counts, z))
    constraints.append(np.maximum(close, np.eye(levels)) @ z <= 1)
    return constraints if allowed.repeats else [*constraints, w <= sums.T @ z]
