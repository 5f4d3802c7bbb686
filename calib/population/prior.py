"""What a type says of one robot more, before anything is measured: ``theta ~ N(mean, covariance)``."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np

from calib.arrays import Array, IntArray

Key: TypeAlias = tuple[str, str, str]
"""Effect, where and name of a parameter."""

_FEW = 3  # degrees of freedom that plausible sizes stand for
_LEAST_SHARE = 0.15


@dataclass(frozen=True, eq=False)
class Prior:
    """Parameters of a robot of the type; base, tool and markers are never among them.

    type : str, name of the robot's model
    keys : tuple of Key; mean : ndarray, shape (k,), SI; covariance : ndarray, shape (k, k), SI, of one
        robot more: between robots, and of the mean
    robots : int, that it was learnt from
    """

    type: str
    keys: tuple[Key, ...]
    mean: Array
    covariance: Array
    robots: int

    def only(self, keys: Collection[Key]) -> Prior:
        """The marginal prior of some parameters."""
        own = np.array([i for i, key in enumerate(self.keys) if key in keys], dtype=int)
        return replace(
            self,
            keys=tuple(self.keys[i] for i in own),
            mean=self.mean[own],
            covariance=self.covariance[np.ix_(own, own)],
        )

    def in_terms_of(self, theirs: Sequence[Key], own: Sequence[Key], B: Array) -> Prior:
        """With some parameters replaced by others, ``own = B theirs``; B of shape (own, theirs)."""
        rest = [key for key in self.keys if key not in theirs]
        order = [self.keys.index(key) for key in (*theirs, *rest)]
        T = np.zeros((len(own) + len(rest), len(self.keys)))
        T[: len(own), order[: len(theirs)]] = B
        T[np.arange(len(own), len(T)), order[len(theirs) :]] = 1.0
        cov = T @ self.covariance @ T.T
        return replace(self, keys=(*own, *rest), mean=T @ self.mean, covariance=(cov + cov.T) / 2.0)

    def combined(self, other: Prior) -> Prior:
        """The joint prior of these parameters and of independent others."""
        k, own = len(self.keys), len(self.keys) + len(other.keys)
        covariance = np.zeros((own, own))
        covariance[:k, :k], covariance[k:, k:] = self.covariance, other.covariance
        mean = np.concatenate([self.mean, other.mean])
        keys = (*self.keys, *other.keys)
        return replace(self, keys=keys, mean=mean, covariance=covariance)

    def widened(self, factor: float, extra: Array) -> Prior:
        """With ``factor`` times the standard deviations, and variances ``extra`` (k,) beside them."""
        return replace(self, covariance=factor**2 * self.covariance + np.diag(extra))

    @property
    def std(self) -> Array:
        """Standard deviations, shape (k,), SI."""
        return np.sqrt(np.diag(self.covariance))

    @cached_property
    def whitening(self) -> Array:
        """W (k, k) with ``W covariance W^T = I``."""
        std = self.std
        half = np.linalg.cholesky(self.covariance / np.outer(std, std))
        return np.asarray(np.linalg.inv(half) / std)

    @property
    def freedom(self) -> float:
        """Degrees of freedom behind its variances."""
        return float(self.robots + _FEW)

    @property
    def share(self) -> float:
        """Of the rows of a sum of squared scores, those that a chi-square of its spread has.

        A score over an estimated deviation has Student's tails: its square varies by
        ``2 (f - 1) / (f - 4)`` about one.
        """
        f = self.freedom
        return max((f - 4.0) / (f - 1.0), _LEAST_SHARE)

    def positions(self, keys: Collection[Key]) -> IntArray:
        """Where its parameters stand among some keys, shape (k,); all of them must be there."""
        order = {key: i for i, key in enumerate(keys)}
        return np.array([order[key] for key in self.keys], dtype=int)
