"""What of a board a detector finds in an image: whether it is there, turned enough and large enough.

The limits are those of OpenCV's detectors on drawn photographs
(``tests.calib.instruments.test_detection``): beside the tilt decides how large a square, or a
marker, is in the direction in which it is foreshortened. So it does how well a point is found.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from calib.arrays import Array, IntArray, Mask

LEAST_SQUARE, LEAST_MARKER = 10.0, 20.0
"""px, of a square of a chessboard and of an ArUco marker or AprilTag, across, as OpenCV finds them."""

_BEAMS, _BEAMS_WHOLE = (
    5,
    25,
)  # lines of sight to a board, and to one of which no point may be hidden
_THIN = 1e-6  # of a square: points that are nearly on one line show no side


@dataclass(frozen=True)
class Detection:
    """When a board counts as seen.

    margin : px, from the edge of the image; tilt : rad, largest angle between the line of sight to a
        point and the normal
    square : float or None, px, least size of what is printed; None for what OpenCV needs
    points : int or None, fewest points of a board; None for what OpenCV needs
    focus : m, nearest and farthest distance along the optical axis
    """

    margin: float = 10.0
    tilt: float = float(np.radians(60.0))
    square: float | None = None
    points: int | None = None
    focus: tuple[float, float] = (0.0, np.inf)


@dataclass(frozen=True, eq=False)
class Board:
    """A shape that is known.

    channels : slice, positions among the readings; points : ndarray, shape (n, 3), m, in its frame; of
        what is printed the z axis goes into the paper
    printed : float, m, side of its smallest figure that must be resolved; 0 for single points, which
        are seen from all sides
    square : float, px, that figure as small as it may look; least : int, fewest points by which the
        board is found
    rim : ndarray, shape (k, 3), m, corners of the print that must be in the image as well
    faced : whether it is known which way the print faces
    """

    name: str
    channels: slice
    points: Array
    printed: float = 0.0
    square: float = 0.0
    least: int = 1
    rim: Array = field(default_factory=lambda: np.zeros((0, 3)))
    faced: bool = True

    def parts(self) -> Iterator[tuple[IntArray, int]]:
        """Points that lie together, by position, and the one among them that stands for them.

        Few enough to ask what hides them: the middle one, and each the farthest from those before.
        """
        from_middle = np.linalg.norm(self.points - self.points.mean(axis=0), axis=1)
        chosen = [int(from_middle.argmin())]
        away = np.full(len(self.points), np.inf)
        whole = self.least == len(self.points)
        while len(chosen) < min(_BEAMS_WHOLE if whole else _BEAMS, len(self.points)):
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

    def rim_viewed(self, viewed: Array) -> Array:
        """The rim (..., k, 3) in the axes in which the points are (..., n, 3)."""
        own = (self.rim - self.points.mean(axis=0))[:, :2]
        return np.asarray(viewed.mean(axis=-2, keepdims=True) + own @ self.axes(viewed))

    def found(self, viewed: Array, seen: Mask, focal: float, limits: Detection) -> Mask:
        """Which of its points (..., n) a detector finds.

        viewed : ndarray, shape (..., n, 3), m, camera axes; seen : ndarray of bool, shape (..., n), in
            the image; focal : px
        """
        if self.printed and self.faced:
            x, y = np.moveaxis(self.axes(viewed), -2, 0)
            normal = np.cross(x, y)
            normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-300)
            away = np.maximum(np.linalg.norm(viewed, axis=-1), 1e-9)
            cosine = (viewed * normal[..., None, :]).sum(axis=-1) / away
            square = self.square if limits.square is None else limits.square
            seen = seen & (cosine >= np.cos(limits.tilt))
            seen &= focal * self.printed * cosine >= square * away
        return np.asarray(seen & self.enough(seen, limits)[..., None])

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

    def enough(self, seen: Mask, limits: Detection) -> Mask:
        """Whether so many of its points are seen (..., n) that a detector finds it, (...)."""
        least = self.least if limits.points is None else min(limits.points, len(self.points))
        return np.asarray(seen.sum(axis=-1) >= least)
