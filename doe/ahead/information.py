"""What readings tell of causes beside all that is modelled, and what further readings add.

Of independent rows of unit variance, N of what is modelled and X of what is asked about, one triangle
answers every question:

    [N X] = Q R,    R = [R_11 R_12; 0 R_22].

``P = (R_11^T R_11)^-1`` is the covariance of what is modelled, ``R_11^-1 R_12`` its imitation of X, and
``S = R_22^T R_22`` the Schur complement, what X shows beyond that. Rows (A, Y) that come later add the
block form of recursive least squares,

    S' = S + D^T (I + A P A^T)^-1 D,    D = Y - A R_11^-1 R_12.

A cause e that is there, of noncentrality lambda once all modelled is projected out, leaves
``lambda_{e|f} = lambda (1 - rho^2)`` beside a rival f that is fitted in its place; rho is the part of
its signal that f imitates. That is the mean by which e wins (the T-criterion; Atkinson and Fedorov,
Biometrika 62(1), 1975). The scores of both differ by about

    mean  lambda_{e|f} + (k_e - k_f) (1 - ln N)
    var   4 lambda_{e|f} + 2 (k_e + k_f) - 4 sum(c^2)

with c the canonical correlations of both, k their directions and N the rows: the first two moments of a
quadratic form in normal readings, less Schwarz's price of the directions. With one direction each and a
large lambda the right one is preferred with probability ``Phi(sqrt(lambda_{e|f}) / 2)``.

A cause of several parameters may be imitated in one direction and not in another. Its worst may be a
combination that nobody meets and its mean hides it, so where nothing is known of its values
probabilities are averaged over parameters drawn at their plausible sizes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from calib.arrays import Array, IntArray
from calib.inference.evidence import VISIBLE, visible_directions
from calib.sobol import Sobol
from calib.solver import triangle

FREE = 10.0
"""Plausible sizes to which what is modelled is known beforehand: what is open is finite."""
SURE = 0.95
"""Probability of preferring the right one at which two causes count as told apart."""
_DRAWS = 64
_FINEST, _LARGEST = 1e-2, 1e10  # noncentralities between which the one that is needed is sought
_HALVINGS = 40
_ROUNDING = 1e-14


@dataclass(frozen=True, eq=False)
class Information:
    """The triangle of all rows so far, and of a weak prior on what is modelled.

    root : ndarray, shape (n + K, n + K), R; n : int, columns of what is modelled, which come first
    rows : int, that count
    """

    root: Array
    n: int
    rows: int

    @classmethod
    def of(cls, rows: Array, n: int) -> Information:
        """From rows (N, n + K), in plausible sizes."""
        weak = np.diag(np.arange(rows.shape[1]) < n) / FREE
        return cls(weak, n, 0).added(rows)

    @cached_property
    def inverse(self) -> Array:
        """``R_11^-1``, shape (n, n)."""
        from scipy.linalg import solve_triangular

        return np.asarray(solve_triangular(self.root[: self.n, : self.n], np.eye(self.n)))

    @property
    def S(self) -> Array:
        """Products of what is left of X, shape (K, K)."""
        rest = self.root[self.n :, self.n :]
        return np.asarray(rest.T @ rest)

    @property
    def lengths(self) -> Array:
        """Of the columns of X before the projection, shape (K,)."""
        return np.asarray(np.linalg.norm(self.root[:, self.n :], axis=0))

    def left(self, rows: Array) -> tuple[Array, Array]:
        """``A R_11^-1`` and D of further rows (..., r, n + K)."""
        along = rows[..., : self.n] @ self.inverse
        return along, np.asarray(rows[..., self.n :] - along @ self.root[: self.n, self.n :])

    def tried(self, rows: Array) -> Array:
        """S with one of m further blocks (m, r, n + K) each, shape (m, K, K)."""
        along, D = self.left(rows)
        V = along @ np.swapaxes(along, -1, -2)
        largest = np.trace(V, axis1=-2, axis2=-1)[..., None, None]
        V += np.eye(V.shape[-1]) * (
            1.0 + _ROUNDING * largest
        )  # beside which rounding loses the one
        return np.asarray(self.S + np.swapaxes(D, -1, -2) @ np.linalg.solve(V, D))

    def added(self, rows: Array) -> Information:
        """With further rows (..., n + K), all of them."""
        flat = rows.reshape(-1, rows.shape[-1])
        count = self.rows + int(np.count_nonzero(flat.any(axis=1)))
        return Information(triangle(np.concatenate([self.root, flat])), self.n, count)


@dataclass(frozen=True, eq=False)
class Likeness:
    """How far each of E causes is confounded with each other. First axis: the cause that is there.

    directions : ndarray of int, shape (..., E), in which each can be seen
    size : ndarray, shape (..., E, D), noncentrality of D signals of each
    left : ndarray, shape (..., E, E, D), ``1 - rho^2``: the part of them that is left beside the other
    crossed : ndarray, shape (..., K, K), products of the directions of all, orthonormal within each
    starts : ndarray of int, shape (E,), where the directions of each begin
    """

    directions: IntArray
    size: Array
    left: Array
    crossed: Array
    starts: IntArray

    @property
    def remaining(self) -> Array:
        """Noncentrality of the signals that is left beside each other, shape (..., E, E, D)."""
        return np.asarray(self.size[..., :, None, :] * self.left)

    @property
    def rho(self) -> Array:
        """Correlation of each cause with its best imitation by each other, shape (E, E)."""
        return np.asarray(np.sqrt(1.0 - self.left.mean(axis=-1)))

    @property
    def rho_worst(self) -> Array:
        """The same in the direction that is imitated best, shape (E, E)."""
        parts = [slice(a, b) for a, b in pairwise([*self.starts, len(self.crossed)])]
        found = [[np.linalg.norm(self.crossed[a, b], 2) for b in parts] for a in parts]
        return np.minimum(found, 1.0)

    @property
    def confounded(self) -> Array:
        """Whether both stand for each other whole, shape (E, E) of bool."""
        exact = ~self.left.any(axis=-1)
        return np.asarray(exact & exact.T)

    @property
    def shared(self) -> Array:
        """Sum of the squared canonical correlations of each two, shape (..., E, E)."""
        squares = np.add.reduceat(self.crossed**2, self.starts, axis=-2)
        return np.asarray(np.add.reduceat(squares, self.starts, axis=-1))

    def preferred(self, noncentrality: Array, rows: int) -> Array:
        """Probability that each cause is preferred to each other, shape (E, E).

        noncentrality : ndarray, shape (E,) or (E, E), of the causes; rows : int, N
        """
        from scipy.special import ndtr

        size = np.asarray(noncentrality)
        size = size[:, None] if size.ndim == 1 else size
        remaining = size[..., None] * self.left
        found = margins(remaining, self.directions, self.shared, rows)
        return np.asarray(ndtr(found).mean(axis=-1))

    def needed(self, rows: int, sure: float = SURE) -> Array:
        """Noncentrality from which on each cause is told from each other, shape (E, E).

        Infinite where the other stands for it at any size, zero where it is told at any: a rival that
        needs more directions for the same loses for that alone.
        """
        low = np.full(self.left.shape[:2], np.log(_FINEST))
        high = np.full(self.left.shape[:2], np.log(_LARGEST))
        never, at_once = (self.preferred(np.exp(x), rows) for x in (high, low))
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            told = self.preferred(np.exp(middle), rows) >= sure
            low, high = np.where(told, low, middle), np.where(told, middle, high)
        found = np.where(at_once >= sure, 0.0, np.exp(high))
        return np.asarray(np.where(never < sure, np.inf, found))


def margins(remaining: Array, k: IntArray, shared: Array, rows: int, lead: float = 0.0) -> Array:
    """Standard deviations by which each cause wins over each other, shape (..., E, E, D).

    beside : ndarray, shape (..., E, E, D), noncentrality that is left of it beside the other
    k : ndarray of int, shape (..., E), directions of each; rows : int, N
    shared : ndarray, shape (..., E, E), sum of the squared canonical correlations
    lead : float, difference of the scores by which it is to win
    """
    mean = (k[..., :, None] - k[..., None, :]) * (1.0 - np.log(max(rows, 3)))
    variance = 2.0 * (k[..., :, None] + k[..., None, :]) - 4.0 * shared
    spread = np.sqrt(np.maximum(4.0 * remaining + variance[..., None], 1e-12))
    return np.asarray((mean[..., None] + remaining - lead) / spread)


def likeness(
    S: Array, lengths: Array, columns: Sequence[IntArray], signals: Sequence[Array]
) -> Likeness:
    """Compare every two causes.

    S : ndarray, shape (..., K, K), products of columns with all that is modelled projected out
    lengths : ndarray, shape (K,), of the columns before
    columns : of each cause among them; signals : of each cause D values (k, D) of its parameters
    """
    order, sizes = np.concatenate(list(columns)), [len(own) for own in columns]
    ends = np.cumsum([0, *sizes])
    parts, starts = [slice(a, b) for a, b in pairwise(ends.tolist())], ends[:-1]
    G, lengths = S[..., order[:, None], order], lengths[order]
    U, seen = np.zeros(G.shape), []
    for at in parts:
        U[..., at, at], own = visible_directions(G[..., at, at], lengths[at])
        seen.append(own.sum(axis=-1))
    Ut = np.swapaxes(U, -1, -2)
    crossed = Ut @ G @ U
    # Only what can be seen of a cause is compared.
    along = [Ut[..., at, at] @ G[..., at, at] @ b for at, b in zip(parts, signals, strict=True)]
    size = np.stack([(z**2).sum(axis=-2) for z in along], axis=-2)
    imitated = np.stack(
        [
            np.add.reduceat((crossed[..., at] @ z) ** 2, starts, axis=-2)
            for at, z in zip(parts, along, strict=True)
        ],
        axis=-3,
    )
    whole = np.where(size > 0.0, size, 1.0)[..., :, None, :]
    left = np.minimum(1.0 - imitated / whole, 1.0)
    left = np.where(left < VISIBLE**2, 0.0, left)  # the rest is rounding
    return Likeness(np.stack(seen, axis=-1), size, left, crossed, starts)


def plausible(sizes: Array) -> Array:
    """Normal draws of parameters (k, D) of plausible sizes (k,), the same at every call."""
    from scipy.special import ndtri

    sampler = Sobol(len(sizes), np.random.default_rng(0))
    return np.asarray(sizes[:, None] * ndtri(sampler.random(_DRAWS)).T)
