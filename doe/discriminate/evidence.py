"""How far readings tell rivals apart.

Truth e moves the markers by ``X_e b``. What remains of that once everything else and the rival f are
fitted, ``lambda = |(I - P_[N, X_f]) X_e b|^2`` in noise variances, is the mean by which e wins (the
T-criterion; Atkinson and Fedorov, Biometrika 62(1), 1975). The difference of both sums of squares is
nearly normal with that mean, ``k_f - k_e`` more of it by the free directions, and variance 4 lambda;
Schwarz's price of a direction is ``ln N``. So e is preferred with probability

    Phi((lambda - (k_e - k_f) (ln N - 1)) / (2 sqrt(lambda))).

For rivals of one parameter each that is right to 0.03, for others to 0.07 (simulated).

Readings that come later enter by the block form of recursive least squares: with P the covariance of
the modelled and D what the rivals' columns show beyond it, a block of rows A adds
``D^T (I + A P A^T)^-1 D`` to the rivals' Gram matrix.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, IntArray
from calib.diagnosis.screen import VISIBLE

_FREE = 10.0  # plausible sizes to which what is modelled is known beforehand
_IMITATES = 100.0  # plausible sizes that a rival may take to imitate another
_LEAST = 1e-12


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

    def tried(self, blocks: Array) -> Array:
        """S with one of m further blocks (m, r, n + K) each, shape (m, K, K)."""
        n = len(self.P)
        A, Y = blocks[..., :n], blocks[..., n:]
        D = Y - A @ self.B
        V = (A @ self.P) @ np.swapaxes(A, -1, -2) + np.eye(A.shape[-2])
        return np.asarray(self.S + np.swapaxes(D, -1, -2) @ np.linalg.solve(V, D))

    def added(self, block: Array) -> Known:
        """With a further block of rows (r, n + K)."""
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
        flat = blocks.reshape(-1, blocks.shape[-1])
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
        N = np.concatenate([rows[:, rest] * sizes[rest], np.eye(n) / _FREE])
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
        score = left[: len(y)].T @ y
        b = tuple(np.linalg.solve(_firm(data.S, at), score[at]) for at in columns)
        return cls(Z, data, columns, b, tuple(pairs))

    def blocks(self, rows: Array) -> Array:
        """Whitened rows (..., r, p) in the coordinates of ``Known``, (..., r, n + K)."""
        return np.asarray(rows @ self.Z)

    def signals(self) -> Array:
        """What each rival explains of the data, in noise variances, shape (rivals,)."""
        S = self.data.S
        return np.array(
            [b @ S[np.ix_(at, at)] @ b for b, at in zip(self.b, self.columns, strict=True)]
        )

    def limits(self, blocks: Array, count: int) -> Array:
        """Upper bound on lambda after any ``count`` of m blocks (m, r, n + K), shape (pairs, 2).

        Lambda is a least squares minimum, and so concave in the weights of the blocks: the plane that
        touches it at even weights lies above. Its slope towards a block is what the rival leaves of
        the truth there.
        """
        share = count / len(blocks)
        even = self.data.merged(np.sqrt(share) * blocks)
        n = len(even.P)
        D = blocks[..., n:] - blocks[..., :n] @ even.B
        found = []
        for e, f in self._directions:
            at, other, b = self.columns[e], self.columns[f], self.b[e]
            imitated = np.linalg.solve(_firm(even.S, other), even.S[np.ix_(other, at)] @ b)
            slope = ((D[..., at] @ b - D[..., other] @ imitated) ** 2).sum(axis=-1)
            best = np.sort(slope)[-count:].sum()
            found.append(self._left(even.S, e, f) + best - share * slope.sum())
        return np.reshape(found, (len(self.pairs), 2))

    @property
    def _directions(self) -> list[tuple[int, int]]:
        """(truth, rival) of every pair, both ways."""
        return [both for e, f in self.pairs for both in ((e, f), (f, e))]

    def separation(self, S: Array) -> Array:
        """Lambda of every direction, shape (..., pairs, 2): either rival as the truth."""
        found = [self._left(S, e, f) for e, f in self._directions]
        return np.stack(found, axis=-1).reshape((*S.shape[:-2], len(self.pairs), 2))

    def _left(self, S: Array, truth: int, rival: int) -> Array:
        e, f, b = self.columns[truth], self.columns[rival], self.b[truth]
        alone = np.einsum("i,...ij,j->...", b, S[..., e[:, None], e], b)
        c = S[..., f[:, None], e] @ b
        taken = (c * np.linalg.solve(_firm(S, f), c[..., None])[..., 0]).sum(axis=-1)
        return np.asarray(np.maximum(alone - taken, 0.0))

    def directions(self, known: Known) -> Array:
        """Number of visible directions of each rival, shape (rivals,): what Schwarz prices."""
        scale = np.sqrt(np.where(known.lengths > 0.0, known.lengths, 1.0))
        S = known.S / np.outer(scale, scale)
        seen = [np.linalg.eigvalsh(S[np.ix_(at, at)]) > VISIBLE**2 for at in self.columns]
        return np.array([int(own.sum()) for own in seen])

    def handicap(self, known: Known, rows: int | None = None) -> Array:
        """``(k_e - k_f) (ln N - 1)`` of every direction, shape (pairs, 2).

        rows : N, where it is not that of ``known``
        """
        k = self.directions(known)
        more = np.array([[k[e] - k[f], k[f] - k[e]] for e, f in self.pairs])
        return np.asarray(more * (np.log(max(known.rows if rows is None else rows, 3)) - 1.0))

    def margins(self, S: Array, handicap: Array) -> Array:
        """Standard deviations by which the truth wins, shape (..., pairs): the worse direction."""
        return margins(self.separation(S), handicap)

    def probabilities(self, known: Known) -> Array:
        """Probability that the truth is preferred, whichever of the two it is, shape (pairs,)."""
        return np.asarray(self.preferences(known).min(axis=-1))

    def preferences(self, known: Known) -> Array:
        """Probability that the truth is preferred, shape (pairs, 2): the first one, the second one."""
        from scipy.special import ndtr

        return np.asarray(ndtr(_margins(self.separation(known.S), self.handicap(known))))


def margins(separation: Array, handicap: Array) -> Array:
    """Standard deviations by which the truth wins in the worse direction, (..., 2) -> (...)."""
    return np.asarray(_margins(separation, handicap).min(axis=-1))


def _margins(separation: Array, handicap: Array) -> Array:
    root = np.sqrt(np.maximum(separation, _LEAST))
    return np.asarray(0.5 * (root - handicap / root))


def _firm(S: Array, at: IntArray) -> Array:
    """Gram matrix (..., k, k) of a rival under the weak prior on its values."""
    return np.asarray(S[..., at[:, None], at] + np.eye(len(at)) / _IMITATES**2)
