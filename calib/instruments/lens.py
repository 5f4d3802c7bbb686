"""Lenses as OpenCV has them: pixels of points in camera axes, and back."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import ClassVar, Self

import numpy as np

from calib.arrays import Array

FOCAL, CENTER, DISTORTION = slice(0, 2), slice(2, 4), slice(4, 9)
_NEAR = 1e-3  # m: what a search puts behind the camera is taken to be this far before it
_TRANSLATION, _LENS = slice(3, 6), slice(6, 15)  # columns of OpenCV's derivatives
_UNDISTORTED = (3, 20, 1e-14)  # by rounds and by accuracy, rounds at most, px


@dataclass(frozen=True, eq=False)
class Lens:
    """Focal lengths, centre and distortion, in OpenCV's order.

    values : ndarray, shape (9,) or (..., 9), fx, fy, cx, cy [px], k1, k2, p1, p2, k3
    """

    values: Array = field(default_factory=lambda: np.array([1.0, 1.0, *[0.0] * 7]))
    names: ClassVar[tuple[str, ...]] = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")

    def moved(self, by: Array) -> Self:
        """The lens with other values, by (..., 9) beyond its own."""
        return replace(self, values=self.values + by)

    def project(self, points: Array) -> Array:
        """Pixels (..., 2) of points (..., 3), m, camera axes: x right, y down, z ahead."""
        return self.linearise(points)[0]

    def linearise(self, points: Array) -> tuple[Array, Array, Array]:
        """Pixels (..., 2), and their derivatives by the points (..., 2, 3) and the lens (..., 2, 9)."""
        import cv2

        batch = self.values.shape[:-1]
        points = np.broadcast_to(points, (*batch, *points.shape[len(batch) :]))
        ahead = np.maximum(points, [-np.inf, -np.inf, _NEAR])
        pixels, J = np.empty((*points.shape[:-1], 2)), np.empty((*points.shape[:-1], 2, 15))
        for at in np.ndindex(batch):
            if not ahead[at].size:
                continue
            K, bent = matrices(self.values[at])
            projected, by = cv2.projectPoints(
                ahead[at].reshape(-1, 1, 3), np.zeros(3), np.zeros(3), K, bent
            )
            pixels[at], J[at] = projected.reshape(pixels[at].shape), by.reshape(J[at].shape)
        by_points = J[..., _TRANSLATION]
        by_points[..., 2] *= (points[..., 2] > _NEAR)[..., None]
        return pixels, by_points, J[..., _LENS]

    def ideal(self, pixels: Array) -> Array:
        """``X / Z, Y / Z`` (..., 2) of pixels (..., 2)."""
        import cv2

        if not pixels.size:
            return pixels
        given = np.ascontiguousarray(pixels, dtype=float).reshape(-1, 1, 2)
        rays = cv2.undistortPointsIter(given, *matrices(self.values), None, None, _UNDISTORTED)
        return np.asarray(rays).reshape(pixels.shape)


def matrices(values: Array) -> tuple[Array, Array]:
    """The camera matrix (3, 3) and the distortion (5,) of OpenCV for a lens's values (9,)."""
    fx, fy, cx, cy = values[:4]
    K = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    return K, np.ascontiguousarray(values[DISTORTION])
