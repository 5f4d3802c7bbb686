"""What is known of rivals after the data, and after each further reading.

Truth e moves the markers by ``X_e b``, b its fit to the data. Readings that come later enter by the
block form of recursive least squares: with P the covariance of the modelled and D what the rivals'
columns show beyond it, a block of rows A adds ``D^T (I + A P A^T)^-1 D`` to the rivals' Gram matrix,
from which follows how alike they are (:mod:`doe.ahead.likeness`).
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, IntArray, stacked
from doe.ahead.likeness import Likeness, directions, likeness, margins

FREE = 10.0
"""Plausible sizes to which what is modelled is known beforehand."""


@dataclass(frozen=True, eq=False)
class Known:
    """Normal equations of all readings so far, the modelled parameters projected out of the rivals.

    P : ndarray, shape (n, n), covariance of what is modelled, in coordinates in which it was the
        identity after the data; B : ndarray, shape (n, K), how it imitates the rivals' columns
    S : ndarray, shape (K, K), Gram matrix of what is left of the rivals
    lengths : ndarray, shape (K,), squared lengths of their columns; rows : int, readings
    """

    P: Array
    B: Array
    S: Array
    lengths: Array
    rows: int

    def directions(self, at: IntArray) -> Array:
        """``U`` (k, k) whose columns make those of a rival orthonormal, zero for what is not seen."""
        return directions(self.S[np.ix_(at, at)], np.sqrt(self.lengths[at]))[0]

    def tried(self, blocks: Array) -> Array:
        """S with one of m further blocks (m, r, n + K) each, shape (m, K, K)."""
        n = len(self.P)
        A, Y = blocks[..., :n], blocks[..., n:]
        D = Y - A @ self.B
        V = (A @ self.P) @ np.swapaxes(A, -1, -2) + np.eye(A.shape[-2])
        return np.asarray(self.S + np.swapaxes(D, -1, -2) @ np.linalg.solve(V, D))

    def added(self, block: Array) -> Known:
        """What is known with a further block of rows (r, n + K)."""
        n = len(self.P)
        A, Y = block[:, :n], block[:, n:]
        D, AP = Y - A @ self.B, A @ self.P
        gain = np.linalg.solve(AP @ A.T + np.eye(len(A)), np.column_stack([AP, D]))
        return Known(
            self.P - AP.T @ gain[:, :n],
            self.B + AP.T @ gain[:, n:],
            self.S + D.T @ gain[:, n:],
            self.lengths + (Y**2).sum(axis=0),
            self.rows + int(np.count_nonzero(np.abs(block).sum(axis=1))),
        )

    def merged(self, blocks: Array) -> Known:
        """With all of m further blocks (m, r, n + K) at once, by the normal equations."""
        n = len(self.P)
        flat = stacked(blocks)
        A, Y = flat[:, :n], flat[:, n:]
        D = Y - A @ self.B
        P = np.asarray(np.linalg.inv(np.linalg.inv(self.P) + A.T @ A), dtype=float)
        C = A.T @ D
        return Known(
            P,
            self.B + P @ C,
            self.S + D.T @ D - C.T @ P @ C,
            self.lengths + (Y**2).sum(axis=0),
            self.rows + int(np.count_nonzero(np.abs(flat).sum(axis=1))),
        )


@dataclass(frozen=True, eq=False)
class Evidence:
    """Rivals beside all that is modelled, as the data know them.

    Z : ndarray, shape (p, n + K), from whitened rows to coordinates of ``Known``
    data : Known, after the data
    columns : tuple of ndarray of int, of each rival among the K
    b : tuple of ndarray, shape (k,), values of each rival in its place, in plausible sizes
    pairs : tuple of (int, int)
    """

    Z: Array
    data: Known
    columns: tuple[IntArray, ...]
    b: tuple[Array, ...]
    pairs: tuple[tuple[int, int], ...]

    @classmethod
    def of(
        cls,
        rows: Array,
        y: Array,
        sizes: Array,
        rivals: Sequence[IntArray],
        pairs: Sequence[tuple[int, int]],
    ) -> Evidence:
        """From whitened rows (N, p) of the data, the columns of all parameters.

        y : ndarray, shape (N,), whitened residual without any of the rivals, to which each is fitted
        sizes : ndarray, shape (p,), plausible sizes; rivals : positions of each rival's parameters
        """
        from scipy.linalg import qr, solve_triangular

        own = np.concatenate(list(rivals))
        rest = np.setdiff1d(np.arange(rows.shape[1]), own)
        n, K = len(rest), len(own)
        # A weak prior, so that what the data leave open is open and yet finite.
        N = np.concatenate([rows[:, rest] * sizes[rest], np.eye(n) / FREE])
        X = np.concatenate([rows[:, own] * sizes[own], np.zeros((n, K))])
        Q, R = qr(N, mode="economic")
        B = Q.T @ X
        left = X - Q @ B
        again = Q.T @ left  # twice is enough: the first projection leaves its rounding
        B, left = B + again, left - Q @ again
        Z = np.zeros((rows.shape[1], n + K))
        Z[rest, :n] = sizes[rest, None] * solve_triangular(R, np.eye(n))
        Z[own, np.arange(n, n + K)] = sizes[own]
        count = int(np.count_nonzero(np.abs(rows).sum(axis=1)))
        data = Known(np.eye(n), B, left.T @ left, (X**2).sum(axis=0), count)
        ends = np.cumsum([0, *map(len, rivals)])
        columns = tuple(np.arange(a, b) for a, b in itertools.pairwise(ends))
        score, seen = left[: len(y)].T @ y, [data.directions(at) for at in columns]
        b = tuple(U @ (U.T @ score[at]) for U, at in zip(seen, columns, strict=True))
        return cls(Z, data, columns, b, tuple(pairs))

    def blocks(self, rows: Array) -> Array:
        """Whitened rows (..., r, p) in the coordinates of ``Known``, (..., r, n + K).

        A pose at which a rival lets the arm stand no more tells nothing.
        """
        stands = np.isfinite(rows).all(axis=(-1, -2), keepdims=True)
        return np.asarray(np.where(stands, rows, 0.0) @ self.Z)

    def likeness(self, known: Known, S: Array | None = None) -> Likeness:
        """How alike the rivals are as they were fitted; S : other Gram matrices (..., K, K)."""
        lengths, values = np.sqrt(known.lengths), [b[:, None] for b in self.b]
        return likeness(known.S if S is None else S, lengths, self.columns, values)

    def of_pairs(self, found: Array) -> Array:
        """Of (..., E, E) both directions of every pair, shape (..., pairs, 2): either as the truth."""
        first, second = np.array(self.pairs, dtype=int).reshape(-1, 2).T
        return np.stack([found[..., first, second], found[..., second, first]], axis=-1)

    def separation(self, known: Known) -> Array:
        """What is left of each rival beside the other, in noise variances, shape (..., pairs, 2)."""
        return self.of_pairs(self.likeness(known).beside[..., 0])

    def margins(
        self,
        known: Known,
        S: Array | None = None,
        rows: int | None = None,
        lead: float = 0.0,
    ) -> Array:
        """Standard deviations by which the truth wins, shape (..., pairs): the worse direction.

        rows : N, where it is not that of ``known``; lead : of -2 log likelihood that it is to win by
        """
        alike = self.likeness(known, S)
        N = known.rows if rows is None else rows
        found = margins(alike.beside, alike.directions, alike.shared, N, lead)[..., 0]
        return np.asarray(self.of_pairs(found).min(axis=-1))

    def preferences(self, known: Known) -> Array:
        """Probability that the truth is preferred, shape (pairs, 2): the first one, the second one."""
        alike = self.likeness(known)
        return self.of_pairs(alike.preferred(alike.size[:, 0], known.rows))

    def probabilities(self, known: Known) -> Array:
        """The same, whichever of the two it is, shape (pairs,)."""
        return np.asarray(self.preferences(known).min(axis=-1))

    def reach(self, blocks: Array, count: int, rows: int) -> Array:
        """Upper bound on the margins after any ``count`` of m blocks (m, r, n + K), shape (pairs,).

        What is left of one beside another is a least squares minimum, and so concave in the weights of
        the blocks: the plane that touches it at even weights lies above. Its slope towards a block is
        what the rival leaves of the truth there.
        """
        share, n = count / len(blocks), len(self.data.P)
        even, whole = self.data.merged(np.sqrt(share) * blocks), self.data.merged(blocks)
        D = blocks[..., n:] - blocks[..., :n] @ even.B
        limit = self.likeness(even).beside
        for f, other in enumerate(self.columns):
            U = even.directions(other)
            for e, (at, b) in enumerate(zip(self.columns, self.b, strict=True)):
                imitated = U @ (U.T @ (even.S[np.ix_(other, at)] @ b))
                slope = ((D[..., at] @ b - D[..., other] @ imitated) ** 2).sum(axis=-1)
                limit[e, f] += np.sort(slope)[-count:].sum() - share * slope.sum()
        k = self.likeness(whole).directions
        # Nothing scatters less than the difference of rivals that share all they can.
        found = margins(limit, k, np.minimum.outer(k, k), rows)[..., 0]
        return np.asarray(self.of_pairs(found).min(axis=-1))
