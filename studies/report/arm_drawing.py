"""The drawing of the arm at each pose that needs no script: what is printed and read aloud.

``arm_view.js`` draws the same again where scripts run: same parts, same order, same places. Colours
and widths are those of ``arm_view.css``.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from markupsafe import Markup

from calib.arrays import Array, IntArray
from studies.plots.view import View
from studies.report.arm_scene import ArmScene

START = View(-52.0, 20.0)
MARKER = 4.5  # px, radius
_JOINT = 4.0  # px, radius
_LETTERED = 20.0  # px; a shorter axis has no letter
_WIDE, _HIGH, _MARGIN = 720.0, 480.0, 32.0  # px


def drawing(scene: ArmScene, key: str) -> Markup:
    """All arms faintly and the first one strongly, as an SVG that needs no script."""
    sheet = Sheet(scene.around.frame)
    parts = [*_stage(scene, sheet), *_all_arms(scene, sheet), *_arm(scene, sheet, 0)]
    return Markup(
        '<svg class="arm-drawing" viewBox="0 0 {:.0f} {:.0f}" role="img" '
        'aria-labelledby="{}-title {}-desc"><title id="{}-title">{}</title>'
        '<desc id="{}-desc">{}</desc><g class="arm-parts">{}</g></svg>'
    ).format(
        _WIDE, _HIGH, key, key, key, title(scene), key, _description(scene), Markup("").join(parts)
    )


class Sheet:
    """A scene seen without perspective, all of its frame in the drawing. Points are in mm."""

    def __init__(self, frame: IntArray) -> None:
        seen = START.flat(np.asarray(frame, dtype=float))
        low, high = seen.min(axis=0), seen.max(axis=0)
        room = np.array([_WIDE, _HIGH]) - 2.0 * _MARGIN
        self.scale = float((room / np.maximum(high - low, 1.0)).min())
        self.middle = (low + high) / 2.0

    def at(self, points: Any) -> Array:
        """Points (..., 3) in the drawing, (..., 2) px."""
        away = (START.flat(points) - self.middle) * self.scale
        return np.asarray(np.array([_WIDE, _HIGH]) / 2.0 + away * [1.0, -1.0])

    def line(self, points: Any) -> str:
        """Path data of a polyline (k, 3)."""
        return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in self.at(points))

    def lines(self, several: Iterable[Any]) -> str:
        """Path data of several polylines."""
        return "".join(self.line(points) for points in several)


def title(scene: ArmScene) -> str:
    """What the drawing is."""
    count = len(scene.poses)
    return f"{scene.name}: the arm at {count} {'pose' if count == 1 else 'poses'}"


def _description(scene: ArmScene) -> str:
    """The drawing in words, for who does not see it."""
    joints, markers = scene.readout(0)
    return (
        f"The arm in its base frame over a floor with cells of {scene.around.step} mm: faintly at "
        f"every pose, strongly at {scene.poses[0]}. Joints: {joints}. Markers: {markers}."
    )


def _stage(scene: ArmScene, sheet: Sheet) -> Iterator[Markup]:
    """Floor with its scale, and obstacles."""
    yield path("arm-floor", sheet.lines(scene.around.floor))
    yield path("arm-foot", sheet.line(scene.around.foot))
    yield from _scale(scene, sheet)
    for outline in scene.around.outlines:
        kind = "arm-plane" if outline.plane else "arm-solid"
        yield path(kind, sheet.lines(outline.lines))
        if outline.radius:
            yield dot("arm-solid", sheet.at(outline.centre), outline.radius * sheet.scale)
        place = sheet.at(outline.centre)
        if ((place >= 0.0) & (place <= [_WIDE, _HIGH])).all():
            yield _text("arm-label arm-middle", place, outline.name)


def _scale(scene: ArmScene, sheet: Sheet) -> Iterator[Markup]:
    """The side of a floor cell at the corner that is lowest in the drawing, with its length."""
    low, high = scene.around.floor.min(axis=(0, 1)), scene.around.floor.max(axis=(0, 1))
    corners = [np.array([x, y, 0]) for x in (low[0], high[0]) for y in (low[1], high[1])]
    corner = max(corners, key=lambda c: float(sheet.at(c)[1]))
    inward = np.where(corner == low, 1, -1) * scene.around.step
    sides = [corner + np.eye(3, dtype=int)[i] * inward for i in (0, 1)]
    side = max(sides, key=lambda s: abs(float(sheet.at(s)[0] - sheet.at(corner)[0])))
    yield path("arm-scale", sheet.line([corner, side]))
    place = sheet.at((corner + side) / 2.0) + np.array([0.0, 15.0])
    yield _text("arm-label arm-middle", place, f"{scene.around.step} mm")


def _triad(sheet: Sheet, origin: Any, axes: Any, names: str, kind: str) -> Iterator[Markup]:
    start = sheet.at(origin)
    for axis, name in zip(axes, names, strict=True):
        end = sheet.at(origin + axis)
        yield path(kind, sheet.line([origin, origin + axis]))
        away = end - start
        length = float(np.linalg.norm(away))
        if length > _LETTERED:
            yield _text(f"{kind}-name arm-middle", end + away / length * 8.0 + [0.0, 4.0], name)


def _all_arms(scene: ArmScene, sheet: Sheet) -> Iterator[Markup]:
    first = next((i for i, point in enumerate(scene.chain) if point >= scene.still), 0)
    moving = list(scene.chain[max(0, first - 1) :])
    tips = "".join(f"M{x:.1f} {y:.1f}h0" for x, y in sheet.at(scene.points[:, moving[-1]]))
    for kind, data in (
        ("arm-all", sheet.lines(scene.points[:, moving])),
        ("arm-tips", tips),
    ):
        yield Markup('<path class="{}" d="{}" opacity="{:.2f}"/>').format(kind, data, fade(scene))


def fade(scene: ArmScene) -> float:
    """Opacity of the arms that are not picked: the more, the fainter."""
    return min(1.0, float(np.sqrt(20.0 / len(scene.poses))))


def _arm(scene: ArmScene, sheet: Sheet, pose: int) -> Iterator[Markup]:
    """One arm with both frames, markers and lines of sight."""
    points = scene.points[pose]
    chain, tip = points[list(scene.chain)], points[scene.chain[-1]]
    on_floor = chain * [1, 1, 0]
    yield path("arm-shadow", sheet.line(on_floor))
    yield path("arm-drop", sheet.line([tip, on_floor[-1]]))
    yield from _bodies(scene, sheet, points)
    if scene.shaped:
        yield path("arm-chain", sheet.line(chain))
    for joint in chain[:-1]:
        yield dot("arm-joint", sheet.at(joint), _JOINT)
    yield from _triad(sheet, np.zeros(3), np.eye(3) * scene.around.step, "XYZ", "arm-base-axis")
    yield from _sight(scene, sheet, pose)
    x, y = scene.tip_axes[pose] / 100.0
    axes = np.array([x, y, np.cross(x, y)]) * scene.around.step * 0.35
    yield from _triad(sheet, tip, axes, "xyz", "arm-tip-axis")
    yield from _markers(scene, sheet, pose)


def _bodies(scene: ArmScene, sheet: Sheet, points: IntArray) -> Iterator[Markup]:
    """Links or capsules, the nearer over the farther: each a broad line over a broader one."""
    near = START.axes[2]
    order = sorted(scene.bodies, key=lambda b: float((points[b.start] + points[b.end]) @ near))
    yield Markup('<g class="{}">').format("arm-shape" if scene.shaped else "arm-links")
    for body in order:
        line, width = sheet.line(points[[body.start, body.end]]), 2.0 * body.radius * sheet.scale
        yield path("arm-rim", line, width + 2.0)
        yield path("arm-body", line, width)
    yield Markup("</g>")


def _sight(scene: ArmScene, sheet: Sheet, pose: int) -> Iterator[Markup]:
    """Lines from the markers to the instrument, or towards it, where it stands far off."""
    if scene.around.instrument is None:
        return
    ends = [_seen_from(scene, scene.points[pose, c]) for c in scene.marker_points]
    for j, (column, end) in enumerate(zip(scene.marker_points, ends, strict=True)):
        kind = "arm-blocked" if (pose, j) in scene.hidden else "arm-sight"
        yield path(kind, sheet.line([scene.points[pose, column], end]))
    if scene.around.far:
        away = float(np.linalg.norm(scene.around.instrument - scene.points[pose, scene.chain[-1]]))
        yield _text("arm-label arm-middle", sheet.at(ends[0]), f"instrument {away / 1e3:.1f} m off")
        return
    foot = scene.around.instrument * [1, 1, 0]
    yield path("arm-drop", sheet.line([scene.around.instrument, foot]))
    x, y = place = sheet.at(scene.around.instrument)
    yield dot("arm-instrument", place, 7.0)
    yield path("arm-instrument", f"M{x - 11:.1f} {y:.1f}h22M{x:.1f} {y - 11:.1f}v22")
    above = np.array([np.clip(x, _MARGIN, _WIDE - _MARGIN), y - 17.0])
    yield _text("arm-label arm-middle", above, "instrument")


def _seen_from(scene: ArmScene, point: IntArray) -> Array:
    """The end of a line of sight from a point."""
    away = np.asarray(scene.around.instrument, dtype=float) - point
    share = (
        3.0 * scene.around.step / max(float(np.linalg.norm(away)), 1.0) if scene.around.far else 1.0
    )
    return np.asarray(point + share * away)


def _markers(scene: ArmScene, sheet: Sheet, pose: int) -> Iterator[Markup]:
    tip = scene.points[pose, scene.chain[-1]]
    for j, (name, column) in enumerate(zip(scene.markers, scene.marker_points, strict=True)):
        point = scene.points[pose, column]
        yield path("arm-tool", sheet.line([tip, point]))
        place = sheet.at(point)
        lost = (pose, j) in scene.hidden
        yield crossed(place) if lost else dot("arm-marker", place, MARKER)
        away = place - sheet.at(tip)
        away = 13.0 * away / max(float(np.linalg.norm(away)), 1.0)
        yield _text("arm-name arm-middle", place + away + [0.0, 4.0], name)


def crossed(at: Array) -> Markup:
    """A hollow dot with a cross."""
    x, y = at - 6.0
    cross = f"M{x:.1f} {y:.1f}l12 12M{x:.1f} {y + 12.0:.1f}l12 -12"
    return dot("arm-marker arm-hidden", at, MARKER) + path("arm-hidden", cross)


def path(kind: str, data: str, width: float | None = None) -> Markup:
    """A path of a class, as broad as its class says, or so many px."""
    if width is None:
        return Markup('<path class="{}" d="{}"/>').format(kind, data)
    return Markup('<path class="{}" d="{}" stroke-width="{:.1f}"/>').format(kind, data, width)


def dot(kind: str, at: Array, radius: float) -> Markup:
    """A circle of a class about a point (2,), radius in px."""
    return Markup('<circle class="{}" cx="{:.1f}" cy="{:.1f}" r="{:.1f}"/>').format(
        kind, *map(float, at), radius
    )


def _text(kind: str, at: Array, text: str) -> Markup:
    return Markup('<text class="{}" x="{:.1f}" y="{:.1f}">{}</text>').format(
        kind, *map(float, at), text
    )
