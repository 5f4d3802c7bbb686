"""A picture as points and parts (lines, dots, rods, words), and as an SVG that needs no script.

What is drawn here is printed and read aloud; ``arm_view.js`` draws the same parts at any pose and from
anywhere. Both know these parts and what is said of them here, and nothing of arms. Colours and widths
are those of ``arm_view.css``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import KW_ONLY, dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
from markupsafe import Markup

from calib.arrays import Array, IntArray


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

    def flat(self, points: Array) -> Array:
        """Points (..., 3) m as seen, (..., 2) m."""
        out: Array = np.asarray(points, dtype=float) @ self.axes[:2].T
        return out


Run: TypeAlias = tuple[int, ...]
"""Points by their numbers, one after the other; ``~c`` is what lies on the floor below point c."""


@dataclass(frozen=True)
class DrawnPart:
    """What stands at some points, under the class or classes ``css``.

    at : tuple of Run
    when : (marker, bool), only at the poses at which this marker is lost, or only where it is not
    """

    css: str
    at: tuple[Run, ...]
    _: KW_ONLY
    when: tuple[int, bool] | None = None


@dataclass(frozen=True)
class Stroke(DrawnPart):
    """A line through the points of each run, all in one path.

    tail : str, path data from the end of each run on, px
    every : bool, at all poses in place of the picked one; opacity : float
    """

    _: KW_ONLY
    tail: str = ""
    every: bool = False
    opacity: float = 1.0


@dataclass(frozen=True)
class Dot(DrawnPart):
    """A circle about each point of the runs, with a radius of so many mm and px."""

    _: KW_ONLY
    mm: int = 0
    px: float = 0.0


@dataclass(frozen=True)
class Rods(DrawnPart):
    """A broad line along each run, nearer ones over farther ones, in a group of their own.

    mm : tuple of int, their radii
    layers : tuple of (str, float), what each is made of: class, and px by which it is wider
    """

    mm: tuple[int, ...]
    layers: tuple[tuple[str, float], ...]


@dataclass(frozen=True)
class Text(DrawnPart):
    """Words in the middle of each run; none where that is outside of the drawing.

    down : float, px
    beyond : (point, px), first moved so far, away from where this point is in the drawing
    least : float, px; none where that point is nearer than this in the drawing
    """

    words: str
    _: KW_ONLY
    down: float = 0.0
    beyond: tuple[int, float] | None = None
    least: float = 0.0


@dataclass(frozen=True, eq=False)
class ArmPicture:
    """What is to be seen at m poses.

    title, description : str
    points : ndarray of int, shape (m, k, 3), mm
    tip : int, the point at which a pose is picked, and which stays in its place in zooming
    lost : tuple of tuple of int, the markers that are lost, for each pose
    frame : ndarray of int, shape (c, 3), mm, corners of all that the drawing must show
    parts : tuple of Part, later ones over earlier ones
    """

    title: str
    description: str
    points: IntArray
    tip: int
    lost: tuple[tuple[int, ...], ...]
    frame: IntArray
    parts: tuple[DrawnPart, ...]


START = Viewpoint(-52.0, 20.0)
_SIZE, _MARGIN = np.array([720.0, 480.0]), 32.0  # px


def drawing(picture: ArmPicture, key: str) -> Markup:
    """The picture at its first pose as SVG.

    key : str, begins the identifiers in it
    """
    sheet = DrawingPlane(picture)
    drawn = [element for part in picture.parts for element in _elements(part, sheet)]
    return Markup(
        '<svg class="arm-drawing" viewBox="0 0 {:.0f} {:.0f}" role="img" '
        'aria-labelledby="{}-title {}-desc"><title id="{}-title">{}</title>'
        '<desc id="{}-desc">{}</desc><g class="arm-parts">{}</g></svg>'
    ).format(*_SIZE, key, key, key, picture.title, key, picture.description, Markup("").join(drawn))


class DrawingPlane:
    """The drawing's plane: a picture seen without perspective, all of its frame in the drawing."""

    def __init__(self, picture: ArmPicture) -> None:
        seen = START.flat(np.asarray(picture.frame, dtype=float))
        low, high = seen.min(axis=0), seen.max(axis=0)
        self.picture = picture
        self.scale = float(((_SIZE - 2.0 * _MARGIN) / np.maximum(high - low, 1.0)).min())
        self.middle = (low + high) / 2.0
        first = picture.points[0]
        points = np.concatenate([first, first[::-1] * [1, 1, 0]])  # so that ~c counts from the end
        self.places, self.depths = self.at(points), points @ START.axes[2]

    def at(self, points: Any) -> Array:
        """Points (..., 3) mm in the drawing, (..., 2) px."""
        away = (START.flat(points) - self.middle) * self.scale
        return np.asarray(_SIZE / 2.0 + away * [1.0, -1.0])

    def runs(self, part: DrawnPart) -> list[Array]:
        """Where a part stands: an array (k, 2) px for each of its runs."""
        return [self.places[list(run)] for run in part.at]


def _elements(part: DrawnPart, sheet: DrawingPlane) -> Iterator[Markup]:
    """A part at the first pose."""
    if part.when is None or (part.when[0] in sheet.picture.lost[0]) == part.when[1]:
        yield from _DRAWN[type(part)](part, sheet)


def _line(part: Stroke, sheet: DrawingPlane) -> Iterator[Markup]:
    runs = sheet.runs(part)
    if part.every:
        runs = [at for run in part.at for at in sheet.at(sheet.picture.points[:, run])]
    data = "".join(_track(places) + part.tail for places in runs)
    opacity = Markup(' opacity="{:.2f}"').format(part.opacity) if part.opacity < 1.0 else ""
    yield Markup('<path class="{}" d="{}"{}/>').format(part.css, data, opacity)


def _dots(part: Dot, sheet: DrawingPlane) -> Iterator[Markup]:
    for x, y in np.concatenate(sheet.runs(part)):
        yield Markup('<circle class="{}" cx="{:.1f}" cy="{:.1f}" r="{:.1f}"/>').format(
            part.css, x, y, part.mm * sheet.scale + part.px
        )


def _rods(part: Rods, sheet: DrawingPlane) -> Iterator[Markup]:
    rods = sorted(
        zip(part.at, part.mm, strict=True), key=lambda rod: sheet.depths[list(rod[0])].mean()
    )
    yield Markup('<g class="{}">').format(part.css)
    for run, radius in rods:
        for css, wider in part.layers:
            yield Markup('<path class="{}" d="{}" stroke-width="{:.1f}"/>').format(
                css, _track(sheet.places[list(run)]), 2.0 * radius * sheet.scale + wider
            )
    yield Markup("</g>")


def _text(part: Text, sheet: DrawingPlane) -> Iterator[Markup]:
    for places in sheet.runs(part):
        at = places.mean(axis=0)
        if part.beyond is not None:
            point, far = part.beyond
            away = at - sheet.places[point]
            length = float(np.linalg.norm(away))
            if length < part.least:
                continue
            at = at + away * far / max(length, 1.0)
        x, y = at[0], at[1] + part.down
        if 0.0 <= x <= _SIZE[0] and 0.0 <= y <= _SIZE[1]:
            yield Markup('<text class="{}" x="{:.1f}" y="{:.1f}">{}</text>').format(
                part.css, x, y, part.words
            )


_DRAWN: dict[type[DrawnPart], Callable[[Any, DrawingPlane], Iterator[Markup]]] = {
    Stroke: _line,
    Dot: _dots,
    Rods: _rods,
    Text: _text,
}


def _track(places: Iterable[Array]) -> str:
    """Path data of a polyline (k, 2) px."""
    return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in places)
