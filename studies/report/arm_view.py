"""The arm at each pose as a figure of the page: a drawing that stands by itself, and what turns it.

``arm_view.js`` draws the same again where scripts run: same parts, same order, same places. Colours
and widths are those of ``arm_view.css``.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from markupsafe import Markup

from calib.poses import IntArray
from calib.se3 import Array
from studies.plots.view import View
from studies.report.arm_scene import ArmScene

START = View(-52.0, 20.0)
_WIDE, _HIGH, _MARGIN = 720.0, 480.0, 28.0
_SIGNS = {"deg": "\N{DEGREE SIGN}", "mm": " mm"}
_JOINT, _MARKER = 4.0, 4.5  # px, radii


class Sheet:
    """A scene seen without perspective, its bounds filling the drawing. Points are in mm."""

    def __init__(self, bounds: IntArray) -> None:
        corners = np.stack(np.meshgrid(*bounds.T, indexing="ij"), axis=-1).reshape(-1, 3)
        seen = START.flat(corners)
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


def figure_html(scene: ArmScene, key: str = "arm") -> Markup:
    """The figure: drawing, controls, a line about the pose shown, legend, and the data for the script.

    key : str, begins the identifiers in it; one of its own for each figure of a page
    """
    joints, markers = readout(scene, 0)
    return Markup(
        """<figure class="arm-view" id="{key}">
<div class="arm-bar" role="group" aria-label="Pose and view" hidden></div>
<div class="arm-stage">{drawing}</div>
<p class="arm-now" aria-live="polite"><b>{pose}</b> <span>{joints}</span> <span>{markers}</span></p>
<ul class="arm-legend">{legend}</ul>
<figcaption>{caption}</figcaption>
<script type="application/json">{data}</script>
</figure>"""
    ).format(
        key=key,
        drawing=drawing(scene, key),
        pose=scene.poses[0],
        joints=joints,
        markers=markers,
        legend=_legend(scene),
        caption=caption(scene),
        data=_in_script(figure_data(scene)),
    )


def readout(scene: ArmScene, pose: int) -> tuple[str, str]:
    """Joint values and markers of a pose in words."""
    joints = [
        f"{name} {_shown(value)}{_SIGNS[unit]}{' (level)' if k == scene.level else ''}"
        for k, (name, unit, value) in enumerate(
            zip(scene.joints, scene.units, scene.values[pose], strict=True)
        )
    ]
    seen = [name for j, name in enumerate(scene.markers) if (pose, j) not in scene.hidden]
    lost = [
        f"{name} {scene.hidden[pose, j]}"
        for j, name in enumerate(scene.markers)
        if (pose, j) in scene.hidden
    ]
    words = f"{', '.join(seen) or 'no marker'} {scene.seen}".rstrip()
    return " \N{MIDDLE DOT} ".join(joints), "; ".join([words, *lost])


def _shown(value: float) -> str:
    return f"{value:.2f}".replace("-", "\N{MINUS SIGN}")


def title(scene: ArmScene) -> str:
    """What the drawing is."""
    return f"{scene.name}: the arm at {len(scene.poses)} pose{'s'[: len(scene.poses) > 1]}"


def description(scene: ArmScene) -> str:
    """The drawing in words, for who does not see it."""
    joints, markers = readout(scene, 0)
    return (
        f"All {len(scene.poses)} poses drawn faintly in the base frame over a floor of {scene.step} mm "
        f"cells; pose {scene.poses[0]} strongly. Joints: {joints}. Markers: {markers}."
    )


def caption(scene: ArmScene) -> str:
    """How to read the drawing."""
    kind = "Markers as measured" if scene.seen == "measured" else "Markers at their first guesses"
    lines = "" if scene.shaped else " The cell gives the arm no shape: links are lines."
    unseen = "Where the instrument stands is not given, so that no line of sight is checked. "
    return (
        f"Nominal arm in the base frame, floor cells {scene.step} mm. {kind}. "
        f"{'' if scene.instrument is not None else unseen}{lines}".strip()
    )


def _legend(scene: ArmScene) -> Markup:
    """Signs that occur in the drawing."""
    middle = np.array([12.0, 9.0])
    signs = [
        (_path("arm-all", "M2 9h20"), "all poses"),
        (_dot("arm-marker", middle, _MARKER), f"marker {scene.seen}".strip()),
    ]
    if scene.hidden:
        lost = "not measured" if scene.seen == "measured" else "hidden"
        signs.append((_crossed(middle), f"marker {lost}"))
    if scene.instrument is not None:
        signs.append((_path("arm-sight", "M1 9h22"), "line of sight"))
    return Markup("").join(
        Markup('<li><svg viewBox="0 0 24 18" aria-hidden="true">{}</svg>{}</li>').format(icon, text)
        for icon, text in signs
    )


def figure_data(scene: ArmScene) -> dict[str, Any]:
    """What the script draws from, in mm and the shown units; numbers of points, not copies."""
    still = scene.still
    reasons = list(dict.fromkeys(scene.hidden.values()))
    return {
        "poses": scene.poses,
        "joints": scene.joints,
        "units": scene.units,
        "level": scene.level,
        "values": scene.values.tolist(),
        "still": scene.points[0, :still].ravel().tolist(),
        "moving": scene.points[:, still:].ravel().tolist(),
        "chain": scene.chain,
        "tip": scene.tip_axes.ravel().tolist(),
        "markers": scene.markers,
        "at": scene.marker_points,
        "reasons": reasons,
        "hidden": [[i, j, reasons.index(why)] for (i, j), why in sorted(scene.hidden.items())],
        "seen": scene.seen,
        "bodies": [[b.start, b.end, b.radius] for b in scene.bodies],
        "shaped": scene.shaped,
        "instrument": None if scene.instrument is None else scene.instrument.tolist(),
        "far": scene.far,
        "solids": [
            {
                "name": o.name,
                "lines": [line.tolist() for line in o.lines],
                "centre": o.centre.tolist(),
                "radius": o.radius,
            }
            for o in scene.outlines
        ],
        "floor": scene.floor.tolist(),
        "foot": scene.foot.tolist(),
        "step": scene.step,
        "bounds": scene.bounds.tolist(),
        "view": [START.azimuth, START.elevation],
    }


def _in_script(data: Any) -> Markup:
    """JSON that no text in it can end: neither ``</script>`` nor ``<!--`` nor an entity is left."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    for sign in "<>&":
        text = text.replace(sign, f"\\u{ord(sign):04x}")
    return Markup(text)  # noqa: S704


def drawing(scene: ArmScene, key: str) -> Markup:
    """All arms faintly and the first one strongly, as an SVG that needs no script."""
    sheet = Sheet(scene.bounds)
    parts = [*_stage(scene, sheet), *_all_arms(scene, sheet), *_arm(scene, sheet, 0)]
    return Markup(
        '<svg class="arm-drawing" viewBox="0 0 {:.0f} {:.0f}" role="img" '
        'aria-labelledby="{}-title {}-desc"><title id="{}-title">{}</title>'
        '<desc id="{}-desc">{}</desc><g class="arm-parts">{}</g></svg>'
    ).format(
        _WIDE, _HIGH, key, key, key, title(scene), key, description(scene), Markup("").join(parts)
    )


def _stage(scene: ArmScene, sheet: Sheet) -> Iterator[Markup]:
    """Floor with its scale, base frame and obstacles."""
    yield _path("arm-floor", sheet.lines(scene.floor))
    yield _path("arm-foot", sheet.line(scene.foot))
    yield from _scale(scene, sheet)
    yield from _triad(sheet, np.zeros(3), np.eye(3) * scene.step, "XYZ", "arm-base-axis")
    for outline in scene.outlines:
        yield _path("arm-solid", sheet.lines(outline.lines))
        if outline.radius:
            yield _dot("arm-solid", sheet.at(outline.centre), outline.radius * sheet.scale)
        yield _text("arm-name arm-middle", sheet.at(outline.centre), outline.name)


def _scale(scene: ArmScene, sheet: Sheet) -> Iterator[Markup]:
    """The side of a floor cell at the corner that is lowest in the drawing, with its length."""
    low, high = scene.floor.min(axis=(0, 1)), scene.floor.max(axis=(0, 1))
    corners = [np.array([x, y, 0]) for x in (low[0], high[0]) for y in (low[1], high[1])]
    corner = max(corners, key=lambda c: float(sheet.at(c)[1]))
    inward = np.where(corner == low, 1, -1) * scene.step
    sides = [corner + np.eye(3, dtype=int)[i] * inward for i in (0, 1)]
    side = max(sides, key=lambda s: float(np.linalg.norm(sheet.at(s) - sheet.at(corner))))
    yield _path("arm-scale", sheet.line([corner, side]))
    place = sheet.at((corner + side) / 2.0) + np.array([0.0, 15.0])
    yield _text("arm-label arm-middle", place, f"{scene.step} mm")


def _triad(sheet: Sheet, origin: Any, axes: Any, names: str, kind: str) -> Iterator[Markup]:
    start = sheet.at(origin)
    for axis, name in zip(axes, names, strict=True):
        end = sheet.at(origin + axis)
        yield _path(kind, sheet.line([origin, origin + axis]))
        away = end - start
        length = float(np.linalg.norm(away))
        if length > _JOINT:
            yield _text(f"{kind}-name arm-middle", end + away / length * 8.0 + [0.0, 4.0], name)


def _all_arms(scene: ArmScene, sheet: Sheet) -> Iterator[Markup]:
    fixed = [i for i, point in enumerate(scene.chain) if point < scene.still]
    moving = list(scene.chain[fixed[-1] if fixed else 0 :])
    yield _path("arm-all", sheet.lines(scene.points[:, moving]))
    tips = sheet.at(scene.points[:, scene.chain[-1]])
    yield _path("arm-tips", "".join(f"M{x:.1f} {y:.1f}h0" for x, y in tips))


def _arm(scene: ArmScene, sheet: Sheet, pose: int) -> Iterator[Markup]:
    """One arm with its markers and lines of sight."""
    points = scene.points[pose]
    chain, tip = points[list(scene.chain)], points[scene.chain[-1]]
    on_floor = chain * [1, 1, 0]
    yield _path("arm-shadow", sheet.line(on_floor))
    yield _path("arm-drop", sheet.line([tip, on_floor[-1]]))
    yield from _bodies(scene, sheet, points)
    if scene.shaped:
        yield _path("arm-chain", sheet.line(chain))
    for joint in chain[:-1]:
        yield _dot("arm-joint", sheet.at(joint), _JOINT)
    yield from _sight(scene, sheet, pose)
    x, y = scene.tip_axes[pose] / 100.0
    axes = np.array([x, y, np.cross(x, y)]) * scene.step * 0.4
    yield from _triad(sheet, tip, axes, "xyz", "arm-tip-axis")
    yield from _markers(scene, sheet, pose)


def _bodies(scene: ArmScene, sheet: Sheet, points: IntArray) -> Iterator[Markup]:
    """Links or capsules, the nearer over the farther: each a broad line over a broader one."""
    near = START.axes[2]
    order = sorted(scene.bodies, key=lambda b: float((points[b.start] + points[b.end]) @ near))
    yield Markup('<g class="{}">').format("arm-shape" if scene.shaped else "arm-links")
    for body in order:
        line, width = sheet.line(points[[body.start, body.end]]), 2.0 * body.radius * sheet.scale
        yield _path("arm-rim", line, width + 2.0)
        yield _path("arm-body", line, width)
    yield Markup("</g>")


def _sight(scene: ArmScene, sheet: Sheet, pose: int) -> Iterator[Markup]:
    """Lines from the markers to the instrument, or towards it, where it stands far off."""
    if scene.instrument is None:
        return
    ends = [_seen_from(scene, scene.points[pose, c]) for c in scene.marker_points]
    for j, (column, end) in enumerate(zip(scene.marker_points, ends, strict=True)):
        kind = "arm-blocked" if (pose, j) in scene.hidden else "arm-sight"
        yield _path(kind, sheet.line([scene.points[pose, column], end]))
    if scene.far:
        away = float(np.linalg.norm(scene.instrument - scene.points[pose, scene.chain[-1]]))
        yield _text("arm-label arm-middle", sheet.at(ends[0]), f"instrument {away / 1e3:.1f} m off")
        return
    foot = scene.instrument * [1, 1, 0]
    yield _path("arm-drop", sheet.line([scene.instrument, foot]))
    x, y = place = sheet.at(scene.instrument)
    yield _dot("arm-instrument", place, 7.0)
    yield _path("arm-instrument", f"M{x - 11:.1f} {y:.1f}h22M{x:.1f} {y - 11:.1f}v22")
    yield _text("arm-label arm-middle", place - [0.0, 17.0], "instrument")


def _seen_from(scene: ArmScene, point: IntArray) -> Array:
    """The end of a line of sight from a point."""
    away = np.asarray(scene.instrument, dtype=float) - point
    share = 3.0 * scene.step / max(float(np.linalg.norm(away)), 1.0) if scene.far else 1.0
    return np.asarray(point + share * away)


def _markers(scene: ArmScene, sheet: Sheet, pose: int) -> Iterator[Markup]:
    tip = scene.points[pose, scene.chain[-1]]
    for j, (name, column) in enumerate(zip(scene.markers, scene.marker_points, strict=True)):
        point = scene.points[pose, column]
        yield _path("arm-tool", sheet.line([tip, point]))
        place = sheet.at(point)
        lost = (pose, j) in scene.hidden
        yield _crossed(place) if lost else _dot("arm-marker", place, _MARKER)
        away = place - sheet.at(tip)
        away = 13.0 * away / max(float(np.linalg.norm(away)), 1.0)
        yield _text("arm-name arm-middle", place + away + [0.0, 4.0], name)


def _crossed(at: Array) -> Markup:
    """A hollow dot with a cross."""
    x, y = at - 6.0
    cross = f"M{x:.1f} {y:.1f}l12 12M{x:.1f} {y + 12.0:.1f}l12 -12"
    return _dot("arm-marker arm-hidden", at, _MARKER) + _path("arm-hidden", cross)


def _path(kind: str, data: str, width: float | None = None) -> Markup:
    if width is None:
        return Markup('<path class="{}" d="{}"/>').format(kind, data)
    return Markup('<path class="{}" d="{}" stroke-width="{:.1f}"/>').format(kind, data, width)


def _dot(kind: str, at: Array, radius: float) -> Markup:
    return Markup('<circle class="{}" cx="{:.1f}" cy="{:.1f}" r="{:.1f}"/>').format(
        kind, *map(float, at), radius
    )


def _text(kind: str, at: Array, text: str) -> Markup:
    return Markup('<text class="{}" x="{:.1f}" y="{:.1f}">{}</text>').format(
        kind, *map(float, at), text
    )
