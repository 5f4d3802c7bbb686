"""Variances of what errs as a whole: joints and tip, at each approach and at each configuration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, IntArray
from calib.cell import Repeatability


@dataclass(frozen=True, eq=False)
class Variances:
    """Variances of n joints, of the tip's translation and of its rotation, each a coordinate.

    scale : float, actual over stated standard deviation of the instrument
    approach, configuration : ndarray, shape (n + 2,), rad^2 or m^2, of what is new at each
        approach, and at each configuration
    """

    scale: float
    approach: Array
    configuration: Array

    @classmethod
    def none(cls, joints: int) -> Variances:
        """The instrument alone, as stated."""
        return cls(1.0, np.zeros(joints + 2), np.zeros(joints + 2))

    @classmethod
    def of_arm(cls, joints: int, arm: Repeatability | None) -> Variances:
        """An arm of known repeatability; none where it is not known."""
        found = cls.none(joints)
        if arm is not None:
            found.approach[-2:] = arm.translation**2, arm.rotation**2
        return found

    @property
    def any(self) -> bool:
        """Whether anything errs as a whole."""
        return bool(self.approach.any() or self.configuration.any())


def lever_of(joints: int) -> IntArray:
    """Which variance each of the n + 6 levers has, shape (n + 6,)."""
    return np.concatenate([np.arange(joints), np.repeat([joints, joints + 1], 3)])
