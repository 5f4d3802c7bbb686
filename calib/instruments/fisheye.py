"""Fisheye lenses by the angle to the axis: OpenCV's ``fisheye`` module, ROS's ``equidistant``."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from calib.arrays import Array
from calib.instruments.lens import CENTER, DISTORTION, FOCAL, Lens, beside, matrix

_WIDEST = 1.52  # rad from the axis, up to which a pixel is led back to a ray: 87 deg
_GRID, _ROUNDS = 400, 50
_AXIS = 1e-4  # of the depth: nearer to the axis the first terms of the series are exact


@dataclass(frozen=True, eq=False)
class Fisheye(Lens):
    """Focal lengths, centre and distortion of an image that grows with the angle, not its tangent.

    ``u = f_x x'' + c_x`` and ``v = f_y y'' + c_y`` with, of ``rho = sqrt(X^2 + Y^2)`` and
    ``t = atan2(rho, Z)``, ``x'' = t (1 + k1 t^2 + k2 t^4 + k3 t^6 + k4 t^8) X / rho``, and y'' alike
    (Kannala and Brandt, IEEE TPAMI 28(8), 2006, as OpenCV has it).

    values : ndarray, shape (8,), fx, fy, cx, cy [px], k1, k2, k3, k4
    """

    values: Array = field(default_factory=lambda: np.array([1.0, 1.0, *[0.0] * 6]))
    model: ClassVar[str] = "fisheye"
    names: ClassVar[tuple[str, ...]] = ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4")

    def project(self, points: Array) -> Array:
        """Pixels (..., 2) of points (..., 3), m, camera axes."""
        own = beside(self.values, points.ndim - 1)
        X, Y, Z = np.moveaxis(points, -1, 0)
        _, _, scale = _scale(own, X, Y, Z)
        fx, fy, cx, cy = own[:4]
        return np.stack([fx * scale * X + cx, fy * scale * Y + cy], axis=-1)

    def linearise(self, points: Array) -> tuple[Array, Array, Array]:
        """Pixels (..., 2), and their derivatives by the points (..., 2, 3) and the lens (..., 2, 8)."""
        own = beside(self.values, points.ndim - 1)
        X, Y, Z = np.moveaxis(points, -1, 0)
        rho, angle, scale = _scale(own, X, Y, Z)
        fx, fy, cx, cy = own[:4]
        squared = X * X + Y * Y + Z * Z
        slope = _slope(own[DISTORTION], angle)
        near = rho < _AXIS * np.abs(Z)
        depth = np.where(near, Z, 1.0)
        by_rho = np.where(
            near,
            2.0 * (own[4] - 1.0 / 3.0) / depth**3,
            (slope * Z / squared - scale) / np.where(near, 1.0, rho) ** 2,
        )
        by_depth = -slope / squared
        by_points = matrix(
            [
                [fx * (scale + X * X * by_rho), fx * X * Y * by_rho, fx * X * by_depth],
                [fy * X * Y * by_rho, fy * (scale + Y * Y * by_rho), fy * Y * by_depth],
            ]
        )
        unit = np.where(near, 1.0 / depth, angle / np.where(near, 1.0, rho))
        powers = [unit * angle ** (2 * i) for i in range(1, 5)]
        one, none = np.ones_like(X), np.zeros_like(X)
        by_lens = matrix(
            [
                [scale * X, none, one, none, *(fx * X * p for p in powers)],
                [none, scale * Y, none, one, *(fy * Y * p for p in powers)],
            ]
        )
        return np.stack([fx * scale * X + cx, fy * scale * Y + cy], axis=-1), by_points, by_lens

    def ideal(self, pixels: Array) -> Array:
        """``X / Z, Y / Z`` (..., 2) of pixels (..., 2), the angle found by bisection."""
        bent = (pixels - self.values[CENTER]) / self.values[FOCAL]
        radius = np.linalg.norm(bent, axis=-1)
        k = self.values[DISTORTION]
        angles = np.linspace(0.0, _WIDEST, _GRID)
        turns = np.flatnonzero(_slope(k, angles) <= 0.0)
        low = np.zeros_like(radius)
        high = np.full_like(radius, angles[turns[0] - 1] if len(turns) else _WIDEST)
        for _ in range(_ROUNDS):
            middle = 0.5 * (low + high)
            below = middle * _growth(k, middle) < radius
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        stretch = np.tan(0.5 * (low + high)) / np.where(radius > 0.0, radius, 1.0)
        return np.asarray(bent * np.where(radius > 0.0, stretch, 1.0)[..., None])


def _scale(own: Array, X: Array, Y: Array, Z: Array) -> tuple[Array, Array, Array]:
    """``rho``, the angle to the axis, and ``x'' / X``."""
    rho = np.hypot(X, Y)
    angle = np.arctan2(rho, Z)
    near = rho < _AXIS * np.abs(Z)
    plain = np.where(near, 1.0 / np.where(near, Z, 1.0), angle / np.where(near, 1.0, rho))
    return rho, angle, plain * _growth(own[DISTORTION], angle)


def _growth(k: Array, angle: Array) -> Array:
    k1, k2, k3, k4 = k
    t = angle * angle
    return np.asarray(1.0 + t * (k1 + t * (k2 + t * (k3 + t * k4))))


def _slope(k: Array, angle: Array) -> Array:
    """Derivative of the bent angle by the angle."""
    k1, k2, k3, k4 = k
    t = angle * angle
    return np.asarray(1.0 + t * (3.0 * k1 + t * (5.0 * k2 + t * (7.0 * k3 + t * 9.0 * k4))))
