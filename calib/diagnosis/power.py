"""Sizes that are found, and with what probability."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from calib.arrays import Array, IntArray
from calib.diagnosis.screen import VISIBLE, Field

POWER = 0.9


@lru_cache(maxsize=256)
def needed_beyond(limit: float, directions: int, power: float = POWER) -> float:
    """Noncentrality at which a score in so many directions exceeds a limit with this probability."""
    from scipy.optimize import brentq

    return float(brentq(lambda x: float(detection(limit, directions, x)) - power, 1e-6, 1e6))


def detection(limit: float, directions: int, noncentrality: Array | float) -> Array:
    """Probability that a score exceeds a limit: the upper tail of noncentral chi-square.

    noncentrality : ndarray of any shape, or a number; the result has its shape
    """
    from scipy.special import chndtr

    return np.asarray(1.0 - chndtr(limit, directions, noncentrality))


def entry_limit(directions: int, rows: int, asked: int, alpha: float) -> float:
    """Score beyond which a cause is believed, of so many asked at readings with so many rows.

    The stricter of a chi-square test at level alpha over all that are asked (Bonferroni), and of
    Schwarz's price of the directions with twice the logarithm of the choice.
    """
    from scipy.special import chdtri

    price = directions * np.log(rows) + 2.0 * np.log(asked)
    return max(float(chdtri(directions, alpha / asked)), float(price))


@dataclass(frozen=True, eq=False)
class Detectable:
    """What readings would show of one cause of k parameters.

    directions : int, in which it can be seen; none where it is hidden
    share : ndarray, shape (k,), of each parameter's signal that is left beside the model
    smallest : ndarray, shape (k,), SI, size of each alone that is found with probability ``POWER``;
        infinite where no size would do
    limit, needed : float, score beyond which it is believed, and noncentrality that reaches it
    """

    directions: int
    share: Array
    smallest: Array
    limit: float
    needed: float

    def found(self, times: Array) -> Array:
        """Probability that the cause is found at multiples of its smallest size, shape (k,)."""
        return detection(self.limit, self.directions, self.needed * np.asarray(times) ** 2)


def detectable(field: Field, columns: IntArray, asked: int, alpha: float) -> Detectable:
    """What readings would show of the cause with these columns, of so many asked."""
    lengths, whole = np.linalg.norm(field.X[:, columns], axis=0), field.lengths[columns]
    share = lengths / np.where(whole > 0.0, whole, 1.0)
    nowhere, visible = np.full(len(columns), np.inf), share > VISIBLE
    directions = field.directions(columns).shape[1]
    if not directions or not visible.any():  # what is left of a combination alone is rounding
        return Detectable(0, share, nowhere, np.inf, np.inf)
    limit = entry_limit(directions, field.rows, asked, alpha)
    needed = needed_beyond(limit, directions)
    smallest = np.divide(np.sqrt(needed), lengths, out=nowhere, where=visible)
    return Detectable(directions, share, smallest, limit, needed)
