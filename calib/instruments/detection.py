"""A board: which of its points an image shows, and how well.

How well a point is found was measured on drawn photographs: it hangs on how large a square, or a
marker, is in the direction in which it is foreshortened.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, IntArray, Mask

LEAST_SQUARE, LEAST_MARKER = 10.0, 20.0
"""px, of a square of a chessboard and of an ArUco marker or AprilTag, across, as OpenCV finds them."""

_BEAMS = 5  # lines of sight to a board
_THIN = 1e-6  # of a square: points that are nearly on one line show no side


@dataclass(frozen=True, eq=False)
class Board:
    """A shape that is known.

    channels : slice, positions among the readings; points : ndarray, shape (n, 3), m, in its frame; of
        what is printed the z axis goes into the paper
    printed : float, m, side of its smallest figure; 0 for single points, which are seen from all sides
    square : float, px, that figure as small as OpenCV finds it; least : int, fewest points that count
    faced : whether it is known which way the print faces
    """

    name: str
    channels: slice
    points: Array
    printed: float = 0.0
    square: float = 0.0
    least: int = 1
    faced: bool = True

    def parts(self) -> Iterator[tuple[IntArray, int]]:
        """Points that lie together, by position, and the one among them that stands for them.

        Few enough to ask what hides them: the middle one, and each the farthest from those before.
        """
        from_middle = np.linalg.norm(self.points - self.points.mean(axis=0), axis=1)
        chosen = [int(from_middle.argmin())]
        away = np.full(len(self.points), np.inf)
        while len(chosen) < min(_BEAMS, len(self.points)):
            last = np.linalg.norm(self.points - self.points[chosen[-1]], axis=1)
            away = np.minimum(away, last)
            chosen.append(int(away.argmax()))
        nearest = np.argmin(
            np.linalg.norm(self.points[:, None] - self.points[chosen], axis=2), axis=1
        )
        for k, one in enumerate(chosen):
            yield np.flatnonzero(nearest == k), one

    def axes(self, viewed: Array) -> Array:
        """The x and y axes (..., 2, 3) of what is printed, in the axes of its points as viewed."""
        own = self.points - self.points.mean(axis=0)
        return np.asarray(
            np.linalg.pinv(own[:, :2]) @ (viewed - viewed.mean(axis=-2, keepdims=True))
        )

    def found(self, viewed: Array, seen: Mask, tilt: float) -> Mask:
        """Which of its points (..., n) count: in the image, enough of them, and facing the camera.

        viewed : ndarray, shape (..., n, 3), m, camera axes; seen : ndarray of bool, shape (..., n), in
            the image; tilt : rad, largest angle between the line of sight to a point and the normal
        """
        if self.printed and self.faced:
            x, y = np.moveaxis(self.axes(viewed), -2, 0)
            normal = np.cross(x, y)
            normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-300)
            away = np.maximum(np.linalg.norm(viewed, axis=-1), 1e-9)
            seen = seen & ((viewed * normal[..., None, :]).sum(axis=-1) / away >= np.cos(tilt))
        return np.asarray(seen & self.enough(seen)[..., None])

    def noise(self, rows: Array) -> Array:
        """By how much noise exceeds that of a large figure, (...), of pixels (..., n, 2) in an image.

        ``sqrt(1 + (2 s_0 / s)^2)``, of the figure's side s, px, across where it is foreshortened most,
        and s_0, as small as a detector finds it. Points that are not read are zero.
        """
        one = np.ones(rows.shape[:-2])
        if not self.printed:
            return one
        read = (rows != 0.0).any(axis=-1)[..., None]
        count = np.maximum(read.sum(axis=-2, keepdims=True), 1)
        own = read * (
            self.points[:, :2] - (read * self.points[:, :2]).sum(-2, keepdims=True) / count
        )
        pixels = rows - rows.sum(axis=-2, keepdims=True) / count
        spread = np.swapaxes(own, -1, -2) @ own
        known = np.linalg.det(spread) > _THIN * np.trace(spread, axis1=-2, axis2=-1) ** 2
        spread[~known] = np.eye(2)
        slopes = np.linalg.solve(spread, np.swapaxes(own, -1, -2) @ pixels)
        side = self.printed * np.linalg.svd(slopes, compute_uv=False)[..., -1]
        grown = np.hypot(one, 2.0 * self.square / np.maximum(side, self.square / 2.0))
        return np.where(known, grown, one)

    def enough(self, seen: Mask) -> Mask:
        """Whether so many of its points are seen (..., n) that they count, (...)."""
        return np.asarray(seen.sum(axis=-1) >= self.least)
