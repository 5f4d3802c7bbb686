"""The paper's section III: base and tool, then the rest, in turn until nothing moves.

Equations (11) to (15) hold to first order only when taken once, because they exchange R_base and
R_robot; here step 1 uses the exact derivative at the present base, and the base is renewed through the
exponential. Alternation is block coordinate descent. It needs many turns where base and tool
correlate with joint offsets, so the turns are made on the normal equations and the model is linearised
anew only when they have settled; the minimum is that of the joint solver.
"""

from __future__ import annotations

import numpy as np

from calib.arrays import Array
from calib.solver import Linearise, Minimum, normal_equations

_SETTLED = 1e-6  # length of a turn in standard deviations of the estimate
_SINGULAR = 1e-13  # of the largest eigenvalue
_MOST_TURNS = 200_000
_MOST_LINEARISATIONS = 60


def alternate(linearise: Linearise, start: Array, placement: Array, rest: Array) -> Minimum:
    """Minimise by turns over two sets of directions.

    start : ndarray, shape (p,); placement : ndarray, shape (p, a), base and tool (step 1)
    rest : ndarray, shape (p, b), geometric and elastostatic parameters (step 2)
    """
    span = np.column_stack([placement, rest])
    a = placement.shape[1]
    blocks = [part for part in (slice(0, a), slice(a, span.shape[1])) if part.stop > part.start]
    values, turns, converged = np.array(start, dtype=float), 0, False
    for _ in range(_MOST_LINEARISATIONS):
        r, J = linearise(values)
        cost, g, A = normal_equations(r, J @ span)
        step, used, settled = _turns(A, g, blocks, _MOST_TURNS - turns)
        turns += used
        values = values + span @ step
        if settled and step @ A @ step <= _SETTLED**2 * max(1.0, float(cost) / max(len(step), 1)):
            converged = True
            break
    r, _ = linearise(values)
    return Minimum(values, np.sum(r**2, axis=-1), np.array(converged), turns)


def _turns(A: Array, g: Array, blocks: list[slice], most: int) -> tuple[Array, int, bool]:
    """Solve ``A step = g`` block by block in turn (Gauss-Seidel): step, turns, whether it settled."""
    inverse = [_inverse(A[part, part]) for part in blocks]
    step, gradient = np.zeros_like(g), g.copy()
    for turn in range(1, most + 1):
        before = step.copy()
        for part, solve in zip(blocks, inverse, strict=True):
            move = solve @ gradient[part]
            step[part] += move
            gradient = gradient - A[:, part] @ move
        change = step - before
        length, moved = float(step @ A @ step), float(change @ A @ change)
        if len(blocks) == 1 or moved <= (1e-3 * _SETTLED) ** 2 * max(1.0, length):
            return step, turn, True
    return step, most, False


def _inverse(A: Array) -> Array:
    """Inverse of a symmetric matrix, columns scaled to one; what rounding alone tells stays put."""
    scale = np.sqrt(np.diag(A))
    scale = np.where(scale > 0.0, scale, 1.0)
    inner = np.linalg.pinv(A / np.outer(scale, scale), rcond=_SINGULAR, hermitian=True)
    return np.asarray(inner / np.outer(scale, scale))
