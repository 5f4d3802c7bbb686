"""What a plan can see: detectable sizes and look-alikes, before anything is measured."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from calib.diagnosis.screen import Field
from calib.poses import IntArray
from calib.se3 import Array

POWER = 0.9


@lru_cache(maxsize=256)
def needed(directions: int, alpha: float, power: float = POWER) -> float:
    """Noncentrality at which a chi-square test of level alpha detects with this probability."""
    from scipy.optimize import brentq
    from scipy.special import chdtri, chndtr

    limit = float(chdtri(directions, alpha))
    return float(brentq(lambda x: 1.0 - chndtr(limit, directions, x) - power, 1e-6, 1e6))


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
