"""What is believed of parameters before anything is measured: ``theta ~ N(0, covariance)``."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np

from calib.arrays import Array, IntArray

Key: TypeAlias = tuple[str, str, str]
"""Effect, where and name of a parameter."""


@dataclass(frozen=True, eq=False)
class Prior:
    """Parameters of a robot; base, tool and markers are never among them.

    keys : tuple of Key; covariance : ndarray, shape (k, k), SI
    """

    keys: tuple[Key, ...]
    covariance: Array

    def only(self, keys: Collection[Key]) -> Prior:
        """The marginal prior of some parameters."""
        own = np.array([i for i, key in enumerate(self.keys) if key in keys], dtype=int)
        return Prior(tuple(self.keys[i] for i in own), self.covariance[np.ix_(own, own)])

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

    def positions(self, keys: Collection[Key]) -> IntArray:
        """Where its parameters stand among some keys, shape (k,); all of them must be there."""
        order = {key: i for i, key in enumerate(keys)}
        return np.array([order[key] for key in self.keys], dtype=int)
