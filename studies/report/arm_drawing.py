"""The sheet on which the arm is drawn: lines, dots, rods and words in space as elements of an SVG.

Colours and widths are those of ``arm_view.css``.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from markupsafe import Markup

from calib.arrays import Array, IntArray

_SIZE, _MARGIN = np.array([720.0, 480.0]), 32.0  # px


@dataclass(frozen=True)
class Viewpoint:
    """A direction of view: azimuth and elevation of the viewer [deg], seen without perspective."""

    azimuth: float
    elevation: float

    @cached_property
    def axes(self) -> Array:
        """Right, up and towards the viewer, rows of shape (3, 3)."""
        a, e = np.radians([self.azimuth, self.elevation])
        right = [-np.sin(a), np.cos(a), 0.0]
        up = [-np.sin(e) * np.cos(a), -np.sin(e) * np.sin(a), np.cos(e)]
        near = [np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)]
        return np.array([right, up, near])

    def flat(self, points: Array | IntArray) -> Array:
        """Points (..., 3) as seen, (..., 2)."""
        out: Array = np.asarray(points, dtype=float) @ self.axes[:2].T
        return out


_VIEW = Viewpoint(-52.0, 20.0)


class Sheet:
    """A plane seen without perspective, all of a frame (c, 3), mm, in it. Points are (k, 3), mm."""

    def __init__(self, frame: IntArray) -> None:
        seen = _VIEW.flat(frame)
        low, high = seen.min(axis=0), seen.max(axis=0)
        self.scale = float(((_SIZE - 2.0 * _MARGIN) / np.maximum(high - low, 1.0)).min())
        self.middle = (low + high) / 2.0

    def at(self, points: Array | IntArray) -> Array:
        """Points (..., 3) in the drawing, (..., 2) px."""
        away = (_VIEW.flat(points) - self.middle) * self.scale
        return np.asarray(_SIZE / 2.0 + away * [1.0, -1.0])

    def lines(
        self, css: str, runs: Iterable[Array | IntArray], tail: str = "", opacity: float = 1.0
    ) -> Markup:
        """A line through the points of each run, all in one path; tail : path data after each, px."""
        data = "".join(self._track(run) + tail for run in runs)
        faint = Markup(' opacity="{:.2f}"').format(opacity) if opacity < 1.0 else ""
        return Markup('<path class="{}" d="{}"{}/>').format(css, data, faint)

    def dots(self, css: str, points: Array | IntArray, px: float = 0.0, mm: float = 0.0) -> Markup:
        """A circle about each point."""
        circle = Markup('<circle class="{}" cx="{:.1f}" cy="{:.1f}" r="{:.1f}"/>')
        radius = mm * self.scale + px
        return Markup().join(circle.format(css, x, y, radius) for x, y in self.at(points))

    def rods(
        self, css: str, runs: Iterable[IntArray], radii: Iterable[int], layers: Sequence[str]
    ) -> Markup:
        """A broad line along each run, nearer ones over farther ones; the first layer is a rim."""
        rods = sorted(
            zip(runs, radii, strict=True), key=lambda rod: float((rod[0] @ _VIEW.axes[2]).mean())
        )
        path = Markup('<path class="{}" d="{}" stroke-width="{:.1f}"/>')
        drawn = [
            path.format(layer, self._track(run), 2.0 * radius * self.scale + rim)
            for run, radius in rods
            for layer, rim in zip(layers, (2.0, 0.0), strict=True)
        ]
        return Markup('<g class="{}">{}</g>').format(css, Markup().join(drawn))

    def words(
        self,
        css: str,
        point: Array | IntArray,
        text: str,
        down: float = 0.0,
        beyond: tuple[Array | IntArray, float] | None = None,
        least: float = 0.0,
    ) -> Markup:
        """Words at a point (3,), none where that is outside of the drawing.

        beyond : moved so far, px, away from another point; none where that is nearer than ``least``
        """
        x, y = at = self.at(point)
        if beyond is not None:
            away = at - self.at(beyond[0])
            length = float(np.linalg.norm(away))
            if length < least:
                return Markup()
            x, y = at + away * beyond[1] / max(length, 1.0)
        y += down
        if not (0.0 <= x <= _SIZE[0] and 0.0 <= y <= _SIZE[1]):
            return Markup()
        element = Markup('<text class="{}" x="{:.1f}" y="{:.1f}">{}</text>')
        return element.format(css, x, y, text)

    def _track(self, run: Array | IntArray) -> str:
        """Path data of a polyline."""
        return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in self.at(run))


def svg(title: str, description: str, drawn: Iterable[Markup], key: str) -> Markup:
    """The drawing; key : begins the identifiers in it."""
    return Markup(
        '<svg class="arm-drawing" viewBox="0 0 {:.0f} {:.0f}" role="img" '
        'aria-labelledby="{}-title {}-desc"><title id="{}-title">{}</title>'
        '<desc id="{}-desc">{}</desc><g class="arm-parts">{}</g></svg>'
    ).format(*_SIZE, key, key, key, title, key, description, Markup().join(drawn))
