"""Sizes that are found, and with what probability."""

from __future__ import annotations

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


def smallest_sizes(field: Field, columns: IntArray, asked: int, alpha: float) -> Array:
    """Size (SI) of each parameter alone at which its cause is found with probability ``POWER``, (k,).

    Infinite where nothing of it is left beside what is modelled.
    """
    directions = field.basis(columns).shape[1]
    left = np.linalg.norm(field.X[:, columns], axis=0)
    visible = left > VISIBLE * field.lengths[columns]
    if not directions:
        return np.full(len(columns), np.inf)
    length = np.sqrt(needed_beyond(entry_limit(directions, field.rows, asked, alpha), directions))
    sizes: Array = np.full(len(columns), np.inf)
    seen = visible & (left > 0.0)
    sizes[seen] = length / left[seen]
    return sizes
