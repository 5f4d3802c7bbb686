"""Lenses as OpenCV has them: pixels of points in camera axes, and back."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import ClassVar, Self

import numpy as np

from calib.arrays import Array

FOCAL, CENTER, DISTORTION = slice(0, 2), slice(2, 4), slice(4, 9)
_NEAR = 1e-3  # m: what a search puts behind the camera is taken to be this far before it
_ROUNDS = 20
_WIDEST = 5.0  # of x' and y': what lies far beside the image, where no lens is known


@dataclass(frozen=True, eq=False)
class Lens:
    """Focal lengths, centre and distortion, whose order is OpenCV's.

    ``u = f_x x'' + c_x`` and ``v = f_y y'' + c_y`` with, of ``x' = X / Z`` and ``r^2 = x'^2 + y'^2``,
    ``x'' = x' (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x' y' + p2 (r^2 + 2 x'^2)``, and y'' alike.

    values : ndarray, shape (9,), fx, fy, cx, cy [px], k1, k2, p1, p2, k3
    """

    values: Array = field(default_factory=lambda: np.array([1.0, 1.0, *[0.0] * 7]))
    names: ClassVar[tuple[str, ...]] = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")

    def moved(self, by: Array) -> Self:
        """The lens with other values, by (..., n) beyond its own n."""
        return replace(self, values=self.values + by)

    def project(self, points: Array) -> Array:
        """Pixels (..., 2) of points (..., 3), m, camera axes: x right, y down, z ahead."""
        x, y, _ = _ideal(points)
        own = broadcastable(self.values, x.ndim)
        return _stretched(own, *_distorted(own, x, y))

    def linearise(self, points: Array) -> tuple[Array, Array, Array]:
        """Pixels (..., 2), and their derivatives by the points (..., 2, 3) and the lens (..., 2, 9)."""
        x, y, depth = _ideal(points)
        own = broadcastable(self.values, x.ndim)
        k1, k2, p1, p2, k3 = own[DISTORTION]
        r2 = x * x + y * y
        radial, slope = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3)), k1 + r2 * (2.0 * k2 + 3.0 * k3 * r2)
        cross = 2.0 * (x * y * slope + p1 * x + p2 * y)
        across_x = radial + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x
        across_y = radial + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x
        xd, yd = _distorted(own, x, y)
        fx, fy = own[FOCAL]
        by_ideal = matrix([[fx * across_x, fx * cross], [fy * cross, fy * across_y]])
        ahead = depth > _NEAR
        none = np.zeros_like(x)
        by_points = by_ideal @ matrix(
            [
                [1.0 / depth, none, np.where(ahead, -x / depth, 0.0)],
                [none, 1.0 / depth, np.where(ahead, -y / depth, 0.0)],
            ]
        )
        one = np.ones_like(x)
        bent = [
            [f * c for c in (a * r2, a * r2**2, *tangential, a * r2**3)]
            for f, a, tangential in (
                (fx, x, (2.0 * x * y, r2 + 2.0 * x * x)),
                (fy, y, (r2 + 2.0 * y * y, 2.0 * x * y)),
            )
        ]
        by_lens = matrix([[xd, none, one, none, *bent[0]], [none, yd, none, one, *bent[1]]])
        return _stretched(own, xd, yd), by_points, by_lens

    def ideal(self, pixels: Array) -> Array:
        """``x', y'`` (..., 2) of pixels (..., 2): what the lens bends is taken back step by step."""
        own = self.values
        xd, yd = np.moveaxis((pixels - own[CENTER]) / own[FOCAL], -1, 0)
        x, y = np.clip(xd, -_WIDEST, _WIDEST), np.clip(yd, -_WIDEST, _WIDEST)
        for _ in range(_ROUNDS):
            bent_x, bent_y = _distorted(own, x, y)
            x = np.clip(x + xd - bent_x, -_WIDEST, _WIDEST)
            y = np.clip(y + yd - bent_y, -_WIDEST, _WIDEST)
        return np.stack([x, y], axis=-1)


def _ideal(points: Array) -> tuple[Array, Array, Array]:
    X, Y, Z = np.moveaxis(points, -1, 0)
    depth = np.maximum(Z, _NEAR)
    return X / depth, Y / depth, depth


def _distorted(own: Array, x: Array, y: Array) -> tuple[Array, Array]:
    k1, k2, p1, p2, k3 = own[DISTORTION]
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    return (
        x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
        y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
    )


def _stretched(own: Array, x: Array, y: Array) -> Array:
    fx, fy, cx, cy = own[:4]
    return np.stack([fx * x + cx, fy * y + cy], axis=-1)


def broadcastable(values: Array, axes: int) -> Array:
    """Values (..., n) as n arrays that go with arrays of so many axes."""
    *batch, n = values.shape
    return np.moveaxis(values, -1, 0).reshape((n, *batch, *[1] * (axes - len(batch))))


def matrix(rows: list[list[Array]]) -> Array:
    """Arrays as rows of a matrix (..., rows, columns)."""
    return np.stack([np.stack(np.broadcast_arrays(*row), axis=-1) for row in rows], axis=-2)
