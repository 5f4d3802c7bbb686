"""Which causes look alike to a plan, and from which size on they are told apart.

A cause e that is there, of noncentrality lambda once all modelled is projected out, leaves
``lambda_{e|f} = lambda (1 - rho^2)`` beside a rival f that is fitted in its place; rho is the part of
its signal that f imitates. The scores of both then differ by about

    mean  lambda_{e|f} + (k_e - k_f) (1 - ln N)
    var   4 lambda_{e|f} + 2 (k_e + k_f) - 4 sum(c^2)

with c the canonical correlations of both, k their directions and N the rows: the first two moments of a
quadratic form in normal readings, less Schwarz's price of the directions. With one direction each and a
large lambda the right one is preferred with probability ``Phi(sqrt(lambda_{e|f}) / 2)``.

A cause of several parameters may be imitated in one direction and not in another. Its worst may be a
combination that nobody meets and its mean hides it, so probabilities are averaged over parameters drawn
at their plausible sizes, each draw scaled to the same lambda.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from calib.arrays import Array, IntArray
from calib.diagnosis.screen import VISIBLE, Field

SURE = 0.95
"""Probability of preferring the right one at which two causes count as told apart."""
_DRAWS = 64
_FINEST, _LARGEST = 1e-2, 1e10  # noncentralities between which the one that is needed is sought
_HALVINGS = 40


@dataclass(frozen=True, eq=False)
class Likeness:
    """How far each of E causes is imitated by each other. First axis: the cause that is there.

    rows : int, readings
    directions : ndarray of int, shape (E,), in which each can be seen
    left : ndarray, shape (E, E, D), ``1 - rho^2`` of D draws of its parameters: the part of its signal
        that is left beside the other
    least : ndarray, shape (E, E), the same in its worst direction
    shared : ndarray, shape (E, E), sum of the squared canonical correlations
    """

    rows: int
    directions: IntArray
    left: Array
    least: Array
    shared: Array

    @property
    def rho(self) -> Array:
        """Correlation of each cause with its best imitation by each other, shape (E, E)."""
        return np.asarray(np.sqrt(1.0 - self.left.mean(axis=-1)))

    @property
    def twins(self) -> Array:
        """Whether both stand for each other whole, shape (E, E) of bool."""
        exact = self.left.max(axis=-1) < VISIBLE**2
        return np.asarray(exact & exact.T)

    def preferred(self, noncentrality: Array) -> Array:
        """Probability that each cause is preferred to each other, shape (E, E).

        noncentrality : ndarray, shape (E,) or (E, E), of the causes
        """
        from scipy.special import ndtr

        k, size = self.directions, np.asarray(noncentrality)
        size = size[:, None] if size.ndim == 1 else size
        mean = (k[:, None] - k) * (1.0 - np.log(self.rows))
        variance = 2.0 * (k[:, None] + k) - 4.0 * self.shared
        beside = size[..., None] * np.where(self.left < VISIBLE**2, 0.0, self.left)
        spread = np.sqrt(np.maximum(4.0 * beside + variance[..., None], 1e-12))
        return np.asarray(ndtr((mean[..., None] + beside) / spread).mean(axis=-1))

    def needed(self, sure: float = SURE) -> Array:
        """Noncentrality from which on each cause is told from each other, shape (E, E).

        Infinite where the other stands for it at any size, zero where it is told at any: a rival that
        needs more directions for the same loses for that alone.
        """
        low = np.full(self.shared.shape, np.log(_FINEST))
        high = np.full(self.shared.shape, np.log(_LARGEST))
        never, at_once = (self.preferred(np.exp(x)) for x in (high, low))
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            told = self.preferred(np.exp(middle)) >= sure
            low, high = np.where(told, low, middle), np.where(told, middle, high)
        found = np.where(at_once >= sure, 0.0, np.exp(high))
        return np.asarray(np.where(never < sure, np.inf, found))


def likeness(field: Field, columns: Sequence[IntArray], sizes: Sequence[Array]) -> Likeness:
    """Compare every two visible causes.

    columns : of each cause in the field; sizes : of each cause, plausible sizes of its parameters, SI
    """
    bases = [field.basis(own) for own in columns]
    k = np.array([basis.shape[1] for basis in bases], dtype=int)
    starts = np.cumsum([0, *k])
    parts = [slice(int(a), int(b)) for a, b in pairwise(starts)]
    U = np.column_stack(bases)
    crossed = U.T @ U
    left = np.empty((len(k), len(k), _DRAWS))
    for e, (own, size) in enumerate(zip(columns, sizes, strict=True)):
        # Only what can be seen of a cause is compared.
        signals = bases[e].T @ (field.X[:, own] * size) @ _normal(len(own))
        signals = signals / np.linalg.norm(signals, axis=0)
        imitated = (crossed[:, parts[e]] @ signals) ** 2
        left[e] = 1.0 - np.add.reduceat(imitated, starts[:-1], axis=0)
    shared = np.add.reduceat(np.add.reduceat(crossed**2, starts[:-1], axis=0), starts[:-1], axis=1)
    worst = np.array([[np.linalg.norm(crossed[a, b], 2) for b in parts] for a in parts])
    return Likeness(
        field.rows, k, np.clip(left, 0.0, 1.0), np.clip(1.0 - worst**2, 0.0, 1.0), shared
    )


def _normal(count: int) -> Array:
    """Evenly spread normal draws, shape (count, D), the same at every call."""
    from scipy.special import ndtri
    from scipy.stats.qmc import Sobol

    sampler = Sobol(count, scramble=True, rng=np.random.default_rng(0))
    return np.asarray(ndtri(sampler.random(_DRAWS)).T)
