"""Corners in images, finer than a pixel: of a chessboard by its gradients, of a tag by its edges.

A gradient at a corner of a chessboard is square to the way from the corner, on all sides alike. At the
corner of a tag blur moves it inwards; edges stay where they are, and meet in the corner.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from calib.arrays import Array

_BLUR = 1.0  # px: sharp edges are stairs, between which gradients point anywhere
_WIDEST, _NARROWEST = 12, 2  # px from the corner
_ALONG = np.linspace(0.15, 0.85, 40)  # of an edge, where it is looked for: the rest is round
_STEP = 0.25  # px across an edge
_ROUNDS = 2


def smooth(cv2: Any, image: Any) -> Any:
    """The image as corners are looked for in it."""
    return cv2.GaussianBlur(image, (0, 0), _BLUR)


def saddles(cv2: Any, image: Any, corners: Array, room: Array) -> Array:
    """Corners of a chessboard (n, 2), px, near those given; room : (n,), px, that is free around."""
    found = corners.copy()
    widths = np.clip(room.astype(int), _NARROWEST, _WIDEST)
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-4)
    for width in np.unique(widths).tolist():
        own = widths == width
        start = np.ascontiguousarray(corners[own].reshape(-1, 1, 2), dtype=np.float32)
        fine = cv2.cornerSubPix(image, start, (width, width), (-1, -1), stop)
        found[own] = np.asarray(fine, dtype=float).reshape(-1, 2)
    return found


def tag_corners(image: Any, corners: Array, cells: int) -> Array:
    """Corners (n, 4, 2), px, of dark tags near those given; cells : across a tag with its border."""
    pixels = np.asarray(image, dtype=float)
    for _ in range(_ROUNDS):
        corners = np.stack([_by_edges(pixels, own, cells) for own in corners])
    return corners


def _by_edges(pixels: Array, corners: Array, cells: int) -> Array:
    """Where the lines through the edges meet; the corner as given where an edge does not show."""
    after = np.roll(corners, -1, axis=0)
    lines = [_line(pixels, a, b, cells) for a, b in zip(corners, after, strict=True)]
    found = corners.copy()
    for k in range(4):
        (n1, d1), (n2, d2) = lines[k - 1], lines[k]
        N = np.array([n1, n2])
        if abs(np.linalg.det(N)) > 0.1:
            found[k] = np.linalg.solve(N, [d1, d2])
    return found


def _line(pixels: Array, a: Array, b: Array, cells: int) -> tuple[Array, float]:
    """The line ``n p = d`` along the edge from a to b, where it becomes light to its left."""
    side = float(np.linalg.norm(b - a))
    along = (b - a) / side
    normal = np.array([along[1], -along[0]])
    reach = np.clip(0.4 * side / cells, 1.5, 6.0)
    across = np.arange(-reach, reach + _STEP, _STEP)
    middle = a + np.outer(_ALONG, b - a)
    at = middle[:, None] + across[:, None] * normal
    slope = np.maximum(np.diff(_sampled(pixels, at), axis=1), 0.0)
    weight = slope.sum(axis=1)
    plain = weight > 0.5 * np.median(weight)
    if not weight.any() or plain.sum() < 5:
        return normal, float(normal @ a)
    off = (slope[plain] @ (across[:-1] + _STEP / 2.0)) / weight[plain]
    points = middle[plain] + off[:, None] * normal
    centre = points.mean(axis=0)
    _, _, axes = np.linalg.svd(points - centre)
    return axes[1], float(axes[1] @ centre)


def _sampled(pixels: Array, at: Array) -> Array:
    """Linear between pixels, whose centres have whole numbers."""
    height, width = pixels.shape
    x = np.clip(at[..., 0], 0.0, width - 1.001)
    y = np.clip(at[..., 1], 0.0, height - 1.001)
    i, j = y.astype(int), x.astype(int)
    v, u = y - i, x - j
    upper = pixels[i, j] * (1.0 - u) + pixels[i, j + 1] * u
    lower = pixels[i + 1, j] * (1.0 - u) + pixels[i + 1, j + 1] * u
    return np.asarray(upper * (1.0 - v) + lower * v)
