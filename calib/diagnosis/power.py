"""What a plan can see: detectable sizes and look-alikes, before anything is measured."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from calib.diagnosis.screen import Field
from calib.poses import IntArray
from calib.se3 import Array

POWER = 0.9


def needed(directions: int, alpha: float, power: float = POWER) -> float:
    """Noncentrality at which a chi-square test of level alpha detects with this probability."""
    from scipy.special import chdtri

    return needed_beyond(float(chdtri(directions, alpha)), directions, power)


@lru_cache(maxsize=256)
def needed_beyond(limit: float, directions: int, power: float = POWER) -> float:
    """Noncentrality at which a score in so many directions exceeds a limit with this probability."""
    from scipy.optimize import brentq

    return float(brentq(lambda x: float(detection(limit, directions, x)) - power, 1e-6, 1e6))


def detection(limit: float, directions: int, noncentrality: Array | float) -> Array:
    """Probability that a score exceeds a limit: the upper tail of noncentral chi-square."""
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


def noncentrality(field: Field, columns: IntArray, values: Array) -> float:
    """Squared length, in standard deviations, of an effect once all modelled is projected out."""
    moved = field.X[:, columns] @ values
    return float(moved @ moved)


def smallest_detectable(field: Field, column: int, alpha: float) -> float:
    """Size (SI) of one parameter that is found with probability ``POWER``; infinite if invisible."""
    length = float(np.linalg.norm(field.X[:, column]))
    if length <= 1e-3 * field.lengths[column] or length == 0.0:
        return np.inf
    return float(np.sqrt(needed(1, alpha)) / length)
