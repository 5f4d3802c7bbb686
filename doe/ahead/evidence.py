"""What is known of rivals after the data, and after each further reading.

Truth e moves the markers by ``X_e b``, b its fit to the data. Readings that come later enter by the
block form of recursive least squares: with P the covariance of the modelled and D what the rivals'
columns show beyond it, a block of rows A adds ``D^T (I + A P A^T)^-1 D`` to the rivals' Gram matrix,
from which follows how alike they are (:mod:`doe.ahead.likeness`).
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.arrays import Array, IntArray
from calib.diagnosis.candidates import Candidate
from calib.diagnosis.equivalence import SAME
from doe.ahead.likeness import Likeness, directions, likeness, margins
from doe.ahead.situation import CandidateRows

FREE = 10.0
"""Plausible sizes to which what is modelled is known beforehand."""
_MARGIN = 1.6448536269514722  # standard deviations of ``SURE``


@dataclass(frozen=True, eq=False)
class ReducedEquations:
    """Normal equations of all readings so far, with the modelled parameters eliminated.

    half : ndarray, shape (n, n), H with ``P = H H^T`` the covariance of what is modelled, in
        coordinates in which it was the identity after the data
    B : ndarray, shape (n, K), how what is modelled imitates the rivals' columns
    S : ndarray, shape (K, K), Gram matrix of what is left of the rivals
    lengths : ndarray, shape (K,), squared lengths of their columns; rows : int, readings
    """

    half: Array
    B: Array
    S: Array
    lengths: Array
    rows: int

    def directions(self, at: IntArray) -> Array:
        """``U`` (k, k) whose columns make those of a rival orthonormal, zero for what is not seen."""
        return directions(self.S[np.ix_(at, at)], np.sqrt(self.lengths[at]))[0]

    def tried(self, blocks: Array) -> Array:
        """S with one of m further blocks (m, r, n + K) each, shape (m, K, K)."""
        n = len(self.B)
        A, Y = blocks[..., :n], blocks[..., n:]
        D, H = Y - A @ self.B, A @ self.half
        V = H @ np.swapaxes(H, -1, -2) + np.eye(A.shape[-2])
        return np.asarray(self.S + np.swapaxes(D, -1, -2) @ np.linalg.solve(V, D))

    def added(self, blocks: Array) -> ReducedEquations:
        """What is known with further rows (..., n + K), all of them."""
        n = len(self.B)
        flat = blocks.reshape(-1, blocks.shape[-1])
        A, Y = flat[:, :n], flat[:, n:]
        D = np.concatenate([np.zeros_like(self.B), Y - A @ self.B])
        Q, R = np.linalg.qr(np.concatenate([np.linalg.inv(self.half), A]))
        half = np.asarray(np.linalg.inv(R), dtype=float)
        along = Q.T @ D
        left = D - Q @ along
        return ReducedEquations(
            half,
            self.B + half @ along,
            self.S + left.T @ left,
            self.lengths + (Y**2).sum(axis=0),
            self.rows + int(np.count_nonzero(np.abs(flat).sum(axis=1))),
        )


@dataclass(frozen=True, eq=False)
class RivalEvidence:
    """Rivals beside all that is modelled, as the data know them.

    Z : ndarray, shape (p, n + K), from whitened rows to coordinates of ``ReducedEquations``
    data : ReducedEquations, after the data
    columns : tuple of ndarray of int, of each rival among the K
    b : tuple of ndarray, shape (k,), values of each rival in its place, in plausible sizes
    pairs : tuple of (int, int), rivals that are compared
    members : tuple of Candidate, the rivals
    planned : int, rows of the data and of the poses to be chosen, None where none are
    """

    Z: Array
    data: ReducedEquations
    columns: tuple[IntArray, ...]
    b: tuple[Array, ...]
    pairs: tuple[tuple[int, int], ...]
    members: tuple[Candidate, ...] = ()
    planned: int | None = None

    @classmethod
    def of(
        cls,
        rows: Array,
        y: Array,
        sizes: Array,
        rivals: Sequence[IntArray],
        pairs: Sequence[tuple[int, int]],
    ) -> RivalEvidence:
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
        data = ReducedEquations(np.eye(n), B, left.T @ left, (X**2).sum(axis=0), count)
        ends = np.cumsum([0, *map(len, rivals)])
        columns = tuple(np.arange(a, b) for a, b in itertools.pairwise(ends))
        score, seen = left[: len(y)].T @ y, [data.directions(at) for at in columns]
        b = tuple(U @ (U.T @ score[at]) for U, at in zip(seen, columns, strict=True))
        return cls(Z, data, columns, b, tuple(pairs))

    @property
    def keys(self) -> list[tuple[str, str]]:
        """Of the pairs, ``effect:where`` of both."""
        return [(self.members[i].key, self.members[j].key) for i, j in self.pairs]

    def without(self, told: Collection[tuple[str, str]]) -> RivalEvidence:
        """The same less some pairs, by their keys."""
        each = zip(self.pairs, self.keys, strict=True)
        return replace(self, pairs=tuple(pair for pair, key in each if key not in told))

    def within_reach(self, offer: CandidateRows, start: Array, count: int) -> RivalEvidence:
        """The same with the pairs that some choice of candidates might tell apart.

        A pair that no choice brings to the margin of ``SURE`` is not worth the poses that others need.

        start : ndarray, shape (dof,), where the arm stands; count : int, poses to be chosen
        """
        blocks = self.blocks(offer.rows(slice(None), start))
        planned = self.data.rows + count * blocks.shape[1]
        reach = self.reach(blocks, min(count, len(blocks)), planned)
        each = zip(self.pairs, reach, strict=True)
        pairs = tuple(pair for pair, margin in each if margin >= _MARGIN)
        return replace(self, pairs=pairs, planned=planned)

    def blocks(self, rows: Array, q: Array | None = None) -> Array:
        """Whitened rows (..., r, p) in the coordinates of ``ReducedEquations``, (..., r, n + K).

        A pose at which a rival lets the arm stand no more tells nothing.
        """
        del q
        stands = np.isfinite(rows).all(axis=(-1, -2), keepdims=True)
        return np.asarray(np.where(stands, rows, 0.0) @ self.Z)

    def likeness(self, known: ReducedEquations, S: Array | None = None) -> Likeness:
        """How alike the rivals are as they were fitted; S : other Gram matrices (..., K, K)."""
        lengths, values = np.sqrt(known.lengths), [b[:, None] for b in self.b]
        return likeness(known.S if S is None else S, lengths, self.columns, values)

    def of_pairs(self, found: Array) -> Array:
        """Of (..., E, E) both directions of every pair, shape (..., pairs, 2): either as the truth."""
        first, second = np.array(self.pairs, dtype=int).reshape(-1, 2).T
        return np.stack([found[..., first, second], found[..., second, first]], axis=-1)

    def separation(self, known: ReducedEquations) -> Array:
        """What is left of each rival beside the other, in noise variances, shape (..., pairs, 2)."""
        return self.of_pairs(self.likeness(known).remaining[..., 0])

    def values(self, known: ReducedEquations, S: Array) -> Array:
        """The margins once the poses are read, by which the truth is to stand alone."""
        return self.margins(known, S, self.planned, SAME)

    def margins(
        self,
        known: ReducedEquations,
        S: Array | None = None,
        rows: int | None = None,
        lead: float = 0.0,
    ) -> Array:
        """Standard deviations by which the truth wins, shape (..., pairs): the worse direction.

        rows : N, where it is not that of ``known``; lead : of -2 log likelihood that it is to win by
        """
        alike = self.likeness(known, S)
        N = known.rows if rows is None else rows
        found = margins(alike.remaining, alike.directions, alike.shared, N, lead)[..., 0]
        return np.asarray(self.of_pairs(found).min(axis=-1))

    def preferences(self, known: ReducedEquations) -> Array:
        """Probability that the truth is preferred, shape (pairs, 2): the first one, the second one."""
        alike = self.likeness(known)
        return self.of_pairs(alike.preferred(alike.size[:, 0], known.rows))

    def probabilities(self, known: ReducedEquations) -> Array:
        """The same, whichever of the two it is, shape (pairs,)."""
        return np.asarray(self.preferences(known).min(axis=-1))

    def reach(self, blocks: Array, count: int, rows: int) -> Array:
        """Upper bound on the margins after any ``count`` of m blocks (m, r, n + K), shape (pairs,).

        What is left of one beside another is a least squares minimum, and so concave in the weights of
        the blocks: the plane that touches it at even weights lies above. Its slope towards a block is
        what the rival leaves of the truth there.
        """
        share, n = count / len(blocks), len(self.data.B)
        even, whole = self.data.added(np.sqrt(share) * blocks), self.data.added(blocks)
        D = blocks[..., n:] - blocks[..., :n] @ even.B
        limit = self.likeness(even).remaining
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
