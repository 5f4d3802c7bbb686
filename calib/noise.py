"""Noise of readings: of points along and across the beam, growing with range; and what whitening is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, IntArray


@dataclass(frozen=True)
class Noise:
    """Standard deviation of a measured point, ``constant + per_metre * range``, in metres.

    along, along_per_m : m and m/m, along the beam
    across, across_per_m : m and m/m, in each of the two directions across it
    """

    along: float
    across: float
    along_per_m: float = 0.0
    across_per_m: float = 0.0

    @property
    def grows(self) -> bool:
        """Whether it depends on where the instrument stands: by range, or along the beam."""
        return self.along != self.across or self.along_per_m != 0.0 or self.across_per_m != 0.0

    @classmethod
    def isotropic(cls, sigma: float) -> Noise:
        """The same standard deviation [m] in every coordinate, at any range."""
        return cls(sigma, sigma)

    @classmethod
    def maximum_permissible(cls, mpe: float, mpe_per_m: float, divisor: float) -> Noise:
        """From a maximum permissible error [m, m/m]: the standard deviation is MPE / divisor."""
        constant, slope = mpe / divisor, mpe_per_m / divisor
        return cls(constant, constant, slope, slope)

    def deviations(self, beams: Array) -> tuple[Array, Array]:
        """Standard deviations [m] along and across beams of shape (..., 3), m."""
        ranges = np.linalg.norm(beams, axis=-1)
        return self.along + self.along_per_m * ranges, self.across + self.across_per_m * ranges

    def whitening(self, beams: Array, sigma: Array) -> Array:
        """Matrices W with ``W cov W^T = I``, shape (..., 3, 3), 1/m.

        beams : ndarray, shape (..., 3), m, from the instrument to the points
        sigma : ndarray, shape (...), m, overriding standard deviation of a point, NaN for none
        """
        along, across = self.deviations(beams)
        along = np.where(np.isnan(sigma), along, sigma)[..., None, None]
        across = np.where(np.isnan(sigma), across, sigma)[..., None, None]
        if np.array_equal(along, across):
            return np.eye(3) / across
        length = np.linalg.norm(beams, axis=-1, keepdims=True)
        u = beams / np.where(length == 0.0, 1.0, length)
        outer = u[..., :, None] * u[..., None, :]
        return (np.eye(3) - outer) / across + outer / along


def counted(W: Array) -> IntArray:
    """How many numbers of each reading count, shape (...), by whitening matrices (..., r, r)."""
    return np.asarray(W.any(axis=-1).sum(axis=-1))


def unwhitened(W: Array, white: Array) -> Array:
    """Numbers (..., r) that W (..., r, r) makes ``white`` (..., r); zero for what does not count.

    Of several the smallest.
    """
    used = np.asarray(W.any(axis=-1, keepdims=True))
    if (
        np.sum(W.any(axis=-2), axis=-1) > used[..., 0].sum(axis=-1)
    ).any():  # rows for fewer numbers
        return np.asarray((np.linalg.pinv(W) @ white[..., None])[..., 0])
    found = np.linalg.solve(W + ~used * np.eye(W.shape[-1]), white[..., None])
    return np.asarray((found * used)[..., 0])
