"""The restricted likelihood of the levels, and where it is largest.

For rows ``y ~ N(X b, V)`` with V linear in the variances theta, and columns X of which nothing is
known,

    -2 log L = log|V| + log|X^T V^-1 X| + y^T P y,    P = V^-1 - V^-1 X (X^T V^-1 X)^-1 X^T V^-1

(Patterson and Thompson, Biometrika 58(3), 1971). Its gradient is ``tr(P V_j) - y^T P V_j P y``;
steps are those of Fisher's scoring, and no variance goes below nothing. Columns of a suspect enter
``y^T P y`` and not the determinant: with and without them the likelihood is of the same data, and
the difference is evidence.

What scatters as a whole moves at most six coordinates of an approach. An orthogonal turn of its rows
leaves those six; the others carry the instrument's noise alone and enter once, by their triangle.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from calib.arrays import Array, IntArray, by_size, in_parts, stacked
from calib.scatter.blocks import Block, Half, Levers
from calib.scatter.poses import Scatter
from calib.solver import triangle

_RIGID = 6
_DEPENDENT = 1e-12
_LOST = 1e-6  # share of a column's length: the root of what is left of twelve digits
_AT_ONCE = 2048  # approaches of a block: more no processor keeps at hand
_FAINT = (
    1e-9  # of a column's length: known of each beforehand, so that none is nothing beside others
)
_MOST_STEPS = 40
SETTLED = 0.05
"""Fall of -2 log likelihood that is not worth another step."""
_ROOM = 4.0  # times the variance that is seen
_LEAST = 0.2**2  # nobody's instrument is five times better than its maker says


@dataclass(frozen=True, eq=False)
class MixedModel:
    """A mixed linear model, its rows turned so that few carry the random effects.

    blocks : tuple of Block
    outside : ndarray, shape (.., f), triangle of the rows that carry the instrument's noise alone
    held : ndarray, shape (h, f), rows of unit variance whatever the levels: a prior
    known : int, of the f columns the first, of which nothing is known beforehand
    beyond : int, rows that count less those in the blocks
    beyond_rigid : int, rows that count and that nothing but the instrument moves
    units : ndarray, shape (v,), variances in SI of each theta at one; the first is that of the
        instrument
    highest : float, no theta but the first becomes larger
    start : ndarray, shape (v,), theta as far as it is known beforehand
    may : ndarray of int, which of it may vary
    """

    blocks: tuple[Block, ...]
    outside: Array
    held: Array
    known: int
    beyond: int
    beyond_rigid: int
    units: Array
    highest: float = np.inf
    start: Array = field(default_factory=lambda: np.zeros(0))
    may: IntArray = field(default_factory=lambda: np.zeros(0, dtype=int))

    @cached_property
    def instrument_products(self) -> Array:
        """Products (f, f) of the rows that carry the instrument's noise alone."""
        return np.asarray(self.outside.T @ self.outside)

    @cached_property
    def prior(self) -> Array:
        """Products (f, f) of the rows of the prior."""
        return np.asarray(self.held.T @ self.held)

    def with_columns(self, chosen: IntArray, known: int, held: Array | None = None) -> MixedModel:
        """The problem of some of its columns, the readings last; ``held`` has as many."""
        return replace(
            self,
            blocks=tuple(replace(b, F=b.F[..., chosen]) for b in self.blocks),
            outside=self.outside[:, chosen],
            held=self.held[:, chosen] if held is None else held,
            known=known,
        )


@dataclass(frozen=True, eq=False)
class Likelihood:
    """-2 log likelihood at some variances, its gradient (v,) and the information on them (v, v).

    diagonal : ndarray, shape (f,), of the triangle of the independent rows
    """

    value: float
    gradient: Array
    information: Array
    diagonal: Array


def mixed_model(
    scatter: Scatter, weighted: Array, F: Array, held: Array, known: int, approaches: bool
) -> MixedModel:
    """Sort the rows of a problem.

    weighted : ndarray, shape (m, R, n + 6), levers, whitened; F : ndarray, shape (m, R, f), whitened
    columns and, last, readings; held : ndarray, shape (h, f)
    approaches : whether they have variances of their own even if no configuration was approached again
    The variances are the instrument's, those of approaches, and those of configurations.
    """
    two = approaches or scatter.has_approaches
    sizes = np.sqrt(np.einsum("mrl,mrl->l", weighted, weighted) / len(weighted))
    kinds, count = scatter.kinds, int(scatter.kinds.max()) + 1
    scale = np.array([np.sqrt((sizes[kinds == k] ** 2).mean()) or 1.0 for k in range(count)])
    H_in, F_in, outside, config = _by_approach(scatter, weighted, 1.0 / scale[kinds], F)
    of_approach, of_place = 1 + kinds[: len(kinds) * two], 1 + count * two + kinds
    blocks = []
    for members in by_size(config):
        parts = min(len(members), -(-members.size // _AT_ONCE))
        for index in np.array_split(members, parts):
            H, F_own = H_in[index], F_in[index]
            fresh = H[..., : len(of_approach)]
            if index.shape[1] > 1:
                blocks.append(Block(fresh, H, of_approach, of_place, F_own))
            else:  # nothing comes again
                levers = np.concatenate([fresh, H], axis=-1)
                owner = np.concatenate([of_approach, of_place])
                blocks.append(Block(levers, H[..., :0], owner, of_place[:0], F_own))
    squares = np.einsum("mrf,mrf->f", F, F) + (held**2).sum(axis=0)
    lengths = np.sqrt(squares[:-1])
    faint = _FAINT * np.diag(np.where(lengths > 0.0, lengths, 1.0))
    held = np.concatenate([held, np.pad(faint, ((0, 0), (0, 1)))])
    inside = sum(b.rows for b in blocks)
    rows = int(np.count_nonzero(F.any(axis=-1)))
    rigid = sum(b.moved for b in blocks)
    units = np.concatenate([[1.0], *([1.0 / scale**2] * (2 if two else 1))])
    problem = MixedModel(tuple(blocks), outside, held, known, rows - inside, rows - rigid, units)
    return replace(problem, highest=_highest(problem, len(weighted)))


def _highest(problem: MixedModel, poses: int) -> float:
    """The largest variance that the rows of so many poses can show: it moves them by what is left.

    A camera's rows hardly follow some displacements of the tip. Without a bound, metres of these pay
    for a pixel that the model lacks.
    """
    alone = independent(problem, np.eye(1, len(problem.units))[0])
    left = alone.triangle_of(problem.outside.shape[1])[-1, -1] ** 2
    scattered = sum(b.rows for b in problem.blocks)
    spare = max(scattered - problem.known, 1)
    return float(_ROOM * left * scattered / spare / poses)


@dataclass(frozen=True, eq=False)
class Independent:
    """The rows of a problem made independent of each other at some variances.

    halves : tuple of Half, of each block; rows : tuple of ndarray, shape (B, A, d, f), of each
    products : ndarray, shape (f, f), of all rows, those of the prior included
    """

    problem: MixedModel
    theta: Array
    halves: tuple[Half, ...]
    rows: tuple[Array, ...]
    products: Array

    def triangle_of(self, count: int) -> Array:
        """Triangle (k, k) of the first k columns, or of as many rows as there are."""
        G = self.products[:count, :count]
        scale = np.sqrt(np.maximum(np.diag(G), 1e-300))
        try:
            R = np.linalg.cholesky(G / np.outer(scale, scale)).T * scale
        except np.linalg.LinAlgError:
            R = np.zeros((0, 0))
        if not R.size or (np.diag(R) < _LOST * scale).any():
            # Squares have lost what is left of some column: the rows themselves have not.
            own, s = self.problem, np.sqrt(self.theta[0])
            blocks = (stacked(rows) for rows in self.rows)
            rows = [r[:, :count] for r in (*blocks, own.outside / s, own.held)]
            R = triangle(np.concatenate(rows))
        return np.asarray(R)

    def pulls(self, combined: Array) -> Array:
        """``y^T P V_j P y`` by every variance j of some residuals, shape (v,).

        combined : ndarray, shape (f,), by which columns and readings make the residuals
        """
        alone = self.problem.outside @ combined
        found = np.zeros(len(self.theta))
        found[0] = float(alone @ alone) / float(self.theta[0]) ** 2
        for block, half, rows in zip(self.problem.blocks, self.halves, self.rows, strict=True):
            found += half.pulls(block, rows @ combined[:, None], len(found))
        return found


def independent(problem: MixedModel, theta: Array) -> Independent:
    """The rows of a problem made independent at variances theta (v,)."""
    halves = tuple(Half.of(b, theta) for b in problem.blocks)
    rows = tuple(half(b.F) for b, half in zip(problem.blocks, halves, strict=True))
    products = problem.instrument_products / theta[0] + problem.prior
    for own in rows:
        flat = stacked(own)
        products = products + flat.T @ flat
    return Independent(problem, theta, halves, rows, np.asarray(products))


def likelihood(problem: MixedModel, theta: Array) -> Likelihood:
    """Of variances theta (v,), in the problem's units."""
    from scipy.linalg import solve_triangular

    p, v = problem.known, len(theta)
    s2 = float(theta[0])
    rows = independent(problem, theta)
    R = rows.triangle_of(problem.outside.shape[1])
    diagonal = np.abs(np.diag(R))
    value = problem.beyond * np.log(s2) + 2.0 * np.log(diagonal[:p]).sum() + R[-1, -1] ** 2
    b = _solution(R)
    # Combinations of columns: the known ones made orthonormal, and what is left of the readings.
    back_from = np.zeros((R.shape[1], p + 1))
    back_from[:p, :p] = solve_triangular(R[:p, :p], np.eye(p))
    back_from[:-1, p], back_from[-1, p] = -b, 1.0
    gradient, information = np.zeros(v), np.zeros((v, v))
    alone = problem.outside @ back_from
    gradient[0] = problem.beyond / s2 - float((alone**2).sum()) / s2**2
    information[0, 0] = problem.beyond / s2**2
    for block, half, own in zip(problem.blocks, rows.halves, rows.rows, strict=True):
        value -= half.log_det
        levers = Levers.of(block, half)
        owner = np.eye(v)[levers.owner]
        gradient += levers.slopes(own @ back_from) @ owner
        information += owner.T @ levers.products() @ owner
    return Likelihood(float(value), gradient, information, diagonal)


def _solution(R: Array) -> Array:
    """Least-squares coefficients of the columns, from the triangle of columns and readings."""
    from scipy.linalg import solve_triangular

    T, z = R[: R.shape[1] - 1, :-1], R[: R.shape[1] - 1, -1]
    diagonal = np.abs(np.diag(T))
    if diagonal.min(initial=np.inf) > _DEPENDENT * diagonal.max(initial=0.0):
        return np.asarray(solve_triangular(T, z))
    return np.asarray(np.linalg.lstsq(T, z, rcond=_DEPENDENT)[0])


def maximised(
    problem: MixedModel,
    theta: Array,
    free: IntArray,
    settled: float = SETTLED,
    found: Likelihood | None = None,
) -> tuple[Array, Likelihood]:
    """Variances at which the likelihood is largest, and the likelihood there.

    theta : ndarray, shape (v,), where the search starts; free : ndarray of int, those that move
    settled : float, fall of -2 log likelihood that is not worth another step
    found : Likelihood, at the start, where it is known
    """
    found = likelihood(problem, theta) if found is None else found
    if not len(free):
        return theta, found
    low, high = _lowest(theta), np.maximum(problem.highest, theta)
    high[0] = np.inf
    for _ in range(_MOST_STEPS):
        inside = free[(theta < high)[free] | (found.gradient > 0.0)[free]]
        if not len(inside):
            break
        move, promised = step(found, theta, inside)
        if promised < settled:
            break
        for _ in range(6):
            trial = np.clip(theta + move, low, high)
            fresh = likelihood(problem, trial)
            if fresh.value <= found.value:
                break
            move = 0.4 * move
        else:
            break
        theta, found = trial, fresh
    return theta, found


def _lowest(theta: Array) -> Array:
    low = np.zeros(len(theta))
    low[0] = _LEAST
    return low


def step(found: Likelihood, theta: Array, free: IntArray) -> tuple[Array, float]:
    """Step of Fisher's scoring that leaves no variance below its bound, and the fall that it promises.

    theta : ndarray, shape (v,), where the likelihood was found; free : those that move
    """
    from scipy.optimize import nnls

    above = theta - _lowest(theta)
    A, g = found.information[np.ix_(free, free)], found.gradient[free]
    np.fill_diagonal(A, np.maximum(np.diag(A), 0.0))  # below nothing is rounding
    size = np.sqrt(np.diag(A))
    size = np.where(size > 0.0, size, 1.0)  # what moves no row has no information
    A_one = A / np.outer(size, size)
    low = max(0.0, -float(np.linalg.eigvalsh(A_one)[0]))  # what rounding took
    C = np.linalg.cholesky(A_one + (1e-9 + 2.0 * low) * np.eye(len(free)))
    x0 = above[free] * size
    target = C.T @ x0 - np.linalg.solve(C, g / size)
    x, _ = nnls(C.T, target)
    move = np.zeros(len(above))
    move[free] = (x - x0) / size
    promised = -float(g @ move[free] + 0.5 * move[free] @ A @ move[free])
    return move, promised


def _by_approach(
    scatter: Scatter, H: Array, scale: Array, F: Array
) -> tuple[Array, Array, Array, IntArray]:
    """Turn the rows of every approach; levers H count in units of ``scale`` (n + 6,).

    Returns what scatters, levers (a, d, n + 6) and columns (a, d, f), the triangle (.., f) of the
    rest, and the configuration of each of the a approaches, (a,).
    """
    groups = by_size(scatter.approach)
    d = min(_RIGID, max((index.shape[1] for index in groups), default=1) * H.shape[1])
    levers, columns, rest, config = [], [], [np.zeros((0, F.shape[-1]))], []
    each = H.shape[1] * F.shape[-1]
    parts = [own[p] for own in groups for p in in_parts(len(own), own.shape[1] * each)]
    for index in parts:
        B = len(index)
        own, left = (a[index].reshape(B, -1, a.shape[-1]) for a in (H, F))
        own = own * scale
        U = np.linalg.svd(own, full_matrices=False)[0][..., :d]
        Ut = np.swapaxes(U, -1, -2)
        inside = Ut @ left
        levers.append(_filled(Ut @ own, d))
        columns.append(_filled(inside, d))
        config.append(scatter.configuration[index[:, 0]])
        if own.shape[1] > d:
            rest.append(triangle(stacked(left - U @ inside)))
    outside = triangle(np.concatenate(rest))
    return np.concatenate(levers), np.concatenate(columns), outside, np.concatenate(config)


def _filled(rows: Array, d: int) -> Array:
    """Rows (B, r, c) of each approach, as many as d, those that it lacks zero."""
    return np.pad(rows, ((0, 0), (0, d - rows.shape[1]), (0, 0)))
