"""How far causes can be separated by readings to come.

A cause e that is there, of noncentrality lambda once all modelled is projected out, leaves
``lambda_{e|f} = lambda (1 - rho^2)`` beside a rival f that is fitted in its place; rho is the part of
its signal that f imitates. That is the mean by which e wins (the T-criterion; Atkinson and Fedorov,
Biometrika 62(1), 1975). The scores of both differ by about

    mean  lambda_{e|f} + (k_e - k_f) (1 - ln N)
    var   4 lambda_{e|f} + 2 (k_e + k_f) - 4 sum(c^2)

with c the canonical correlations of both, k their directions and N the rows: the first two moments of a
quadratic form in normal readings, less Schwarz's price of the directions. The worst combination of a
cause's parameters may be one that nobody meets, and their mean hides it: probabilities are averaged
over parameters drawn at their plausible sizes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from calib.arrays import Array, IntArray
from calib.inference.evidence import VISIBLE, visible_directions
from calib.sobol import Sobol

SURE = 0.95
"""Probability of preferring the right one at which two causes count as separated."""
_DRAWS = 64
_FINEST, _LARGEST = 1e-2, 1e10  # noncentralities between which the one that is needed is sought
_HALVINGS = 40


@dataclass(frozen=True, eq=False)
class Likeness:
    """How far each of E causes is confounded with each other. First axis: the cause that is there.

    directions : ndarray of int, shape (E,), in which each can be seen
    left : ndarray, shape (E, E, D), ``1 - rho^2``: the part of D signals of each that is left beside
        the other
    shared : ndarray, shape (E, E), sum of the squared canonical correlations of each two
    rho_worst : ndarray, shape (E, E), correlation in the direction that is imitated best
    """

    directions: IntArray
    left: Array
    shared: Array
    rho_worst: Array

    @property
    def rho(self) -> Array:
        """Correlation of each cause with its best imitation by each other, shape (E, E)."""
        return np.asarray(np.sqrt(1.0 - self.left.mean(axis=-1)))

    @property
    def confounded(self) -> Array:
        """Whether both stand for each other whole, shape (E, E) of bool."""
        exact = ~self.left.any(axis=-1)
        return np.asarray(exact & exact.T)

    def preferred(self, noncentrality: Array, rows: int) -> Array:
        """Probability that each cause is preferred to each other, shape (E, E).

        noncentrality : ndarray, shape (E,) or (E, E), of the causes; rows : int, N
        """
        from scipy.special import ndtr

        size = np.asarray(noncentrality)
        remaining = (size[:, None] if size.ndim == 1 else size)[..., None] * self.left
        k, other = self.directions[:, None], self.directions
        mean = (k - other) * (1.0 - np.log(max(rows, 3)))
        variance = 2.0 * (k + other) - 4.0 * self.shared
        spread = np.sqrt(np.maximum(4.0 * remaining + variance[..., None], 1e-12))
        return np.asarray(ndtr((mean[..., None] + remaining) / spread).mean(axis=-1))

    def needed(self, rows: int, sure: float = SURE) -> Array:
        """Noncentrality from which on each cause is told from each other, shape (E, E).

        Infinite where the other stands for it at any size, zero where it is told at any: a rival that
        needs more directions for the same loses for that alone.
        """
        low = np.full(self.shared.shape, np.log(_FINEST))
        high = np.full(self.shared.shape, np.log(_LARGEST))
        never, at_once = (self.preferred(np.exp(x), rows) for x in (high, low))
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            enough = self.preferred(np.exp(middle), rows) >= sure
            low, high = np.where(enough, low, middle), np.where(enough, middle, high)
        least = np.where(at_once >= sure, 0.0, np.exp(high))
        return np.asarray(np.where(never < sure, np.inf, least))


def likeness(
    S: Array, lengths: Array, columns: Sequence[IntArray], signals: Sequence[Array]
) -> Likeness:
    """Compare every two causes.

    S : ndarray, shape (K, K), products of columns with all that is modelled projected out
    lengths : ndarray, shape (K,), of the columns before
    columns : of each cause among them; signals : of each cause D values (k, D) of its parameters
    """
    bases = [visible_directions(S[np.ix_(own, own)], lengths[own]) for own in columns]
    starts = np.cumsum([0, *map(len, columns)])
    parts = [slice(a, b) for a, b in pairwise(starts.tolist())]
    order = np.concatenate(list(columns))
    U = np.zeros((len(order), len(order)))
    for at, (basis, _) in zip(parts, bases, strict=True):
        U[at, at] = basis
    crossed = U.T @ S[np.ix_(order, order)] @ U
    left = []
    for own, at, (basis, _), drawn in zip(columns, parts, bases, signals, strict=True):
        along = basis.T @ S[np.ix_(own, own)] @ drawn  # what can be seen of a cause, alone
        imitated = np.add.reduceat((crossed[:, at] @ along) ** 2, starts[:-1], axis=0)
        size = (along**2).sum(axis=0)
        left.append(np.minimum(1.0 - imitated / np.where(size > 0.0, size, 1.0), 1.0))
    beside, squares = np.array(left), np.add.reduceat(crossed**2, starts[:-1], axis=0)
    return Likeness(
        np.array([int(seen.sum()) for _, seen in bases]),
        np.where(beside < VISIBLE**2, 0.0, beside),  # the rest is rounding
        np.add.reduceat(squares, starts[:-1], axis=1),
        np.minimum([[np.linalg.norm(crossed[a, b], 2) for b in parts] for a in parts], 1.0),
    )


def plausible(sizes: Array) -> Array:
    """Normal draws of parameters (k, D) of plausible sizes (k,), the same at every call."""
    from scipy.special import ndtri

    even = Sobol(len(sizes), np.random.default_rng(0)).random(_DRAWS)
    return np.asarray(sizes[:, None] * ndtri(even).T)
