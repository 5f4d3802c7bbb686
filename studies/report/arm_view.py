"""The figure of the arm at all poses: the drawing, and how to read it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from markupsafe import Markup

from calib.arrays import Array, IntArray
from studies.report.arm_drawing import Sheet, svg
from studies.report.arm_instruments import DROPPED
from studies.report.arm_scene import ArmScene
from studies.report.surroundings import SceneObject, whole_mm


def figure_html(scene: ArmScene, key: str = "arm") -> Markup:
    """The figure: drawing, a line about the pose drawn strongly, and legend.

    key : str, begins the identifiers in it; one of its own for each figure of a page
    """
    joints, markers = scene.readout(0)
    return Markup(
        """<figure class="arm-view" id="{key}">
<div class="arm-stage">{drawing}</div>
<p class="arm-now"><b>{pose}</b> <span>{joints}</span> <span>{markers}</span></p>
<ul class="arm-legend">{legend}</ul>
<figcaption>{caption}</figcaption>
</figure>"""
    ).format(
        key=key,
        drawing=drawing(scene, key),
        pose=scene.poses[0],
        joints=joints,
        markers=markers,
        legend=_legend(scene),
        caption=_caption(scene),
    )


def _caption(scene: ArmScene) -> str:
    """How to read the drawing."""
    parts = [f"Nominal arm in the base frame, floor cells {scene.around.step} mm."]
    if scene.reads:
        parts.append(
            "Instruments and markers as the cell gives them, or where an identification starts."
        )
    elif scene.markers:
        measured = scene.seen == "measured"
        parts.append("Markers as measured." if measured else "Markers as the cell gives them.")
    away = [f"{name} stands {far:.1f} m from the base" for name, far in scene.beyond.items()]
    parts += [f"Not in the picture: {', '.join(away)}."] if away else []
    alone = not scene.fixtures and not scene.beyond
    if scene.around.instrument is None and scene.seen != "measured" and alone:
        parts.append("Where the instrument stands is not given: no line of sight is checked.")
    if not scene.shaped:
        parts.append("The cell gives the arm no shape: its links are bars.")
    return " ".join(parts)


def _legend(scene: ArmScene) -> Markup:
    """Signs that occur in the drawing."""
    signs = [
        (_path("arm-all", "M2 9h20"), "all poses"),
        (_marker("arm-marker"), f"marker {scene.seen}".strip()),
    ]
    if scene.lost(0):
        lost = "not measured" if scene.seen == "measured" else "hidden"
        crossed = _marker("arm-marker arm-hidden") + _path("arm-hidden", f"M12 9{CROSS}")
        signs.append((crossed, f"marker {lost}"))
    present = {own.kind for own in scene.fixtures}
    signs += [(icon, words) for kind, (icon, words) in _SIGNS.items() if kind in present]
    if not scene.markers:
        del signs[1]
    if scene.around.instrument is not None:
        signs.append((_path("arm-sight", "M1 9h22"), "line of sight"))
    return Markup("").join(
        Markup('<li><svg viewBox="0 0 24 18" aria-hidden="true">{}</svg>{}</li>').format(icon, text)
        for icon, text in signs
    )


def _path(css: str, data: str) -> Markup:
    return Markup('<path class="{}" d="{}"/>').format(css, data)


def _marker(css: str) -> Markup:
    return Markup('<circle class="{}" cx="12" cy="9" r="{}"/>').format(css, MARKER)


_SIGNS = {
    "camera": (
        _path("arm-camera", "M3 9L20 2V16ZM20 2V16")
        + Markup('<circle class="arm-camera" cx="3" cy="9" r="2.5"/>'),
        "camera and what it sees",
    ),
    "board": (_path("arm-board", "M4 4h16v10h-16z"), "board"),
    "frame": (_path("arm-frame", "M6 14h11M6 14v-11M6 14l8 -6"), "body that is read"),
    "socket": (Markup('<circle class="arm-socket" cx="12" cy="9" r="5"/>'), "socket"),
    "touched": (_path("arm-touched", "M2 13l6 -8h14l-6 8z"), "plane that is touched"),
    "wire": (_path("arm-wire", "M2 9h20"), "bar or wire, from its anchor"),
    "instrument": (Markup('<circle class="arm-instrument" cx="12" cy="9" r="5"/>'), "instrument"),
}


CROSS = "m-6 -6l12 12m-12 0l12 -12"
MARKER = 4.5  # px, radius
DOT = {
    "camera": 3.5, "board": 1.6, "frame": 3.0, "socket": 6.0, "touched": 1.5,
    "wire": 4.0, "instrument": 6.0,
}  # fmt: skip
_JOINT = 4  # px, radius
_TARGET = "m-11 0h22m-11 -11v22"
_FAINT = 20  # poses; of more, the faint ones fade
_TIP_AXIS = 0.35  # floor cells
_SIGHT = 3.0  # floor cells of a line of sight whose instrument is not in the picture
_FLOOR = np.array([1, 1, 0])


def drawing(scene: ArmScene, key: str) -> Markup:
    """The arm at the first pose, faintly at all others, and what stands around it."""
    sheet, tip = Sheet(scene.around.frame), scene.chain[0, -1]
    tip_axes = np.rint(scene.tip_axes[0] * scene.around.step * _TIP_AXIS).astype(int)
    parts = (
        *_stage(scene, sheet),
        *_all_arms(scene, sheet),
        *_arm(scene, sheet),
        *_branches(scene, sheet),
        *_sight(scene, sheet),
        *_triad(sheet, tip, tip + tip_axes, "xyz", "arm-tip-axis"),
        *_fixtures(scene, sheet),
        *_markers(scene, sheet),
    )
    count, (joints, read) = len(scene.poses), scene.readout(0)
    return svg(
        f"{scene.name}: the arm at {count} {'pose' if count == 1 else 'poses'}",
        f"The arm in its base frame over a floor with cells of {scene.around.step} mm: "
        f"faintly at every pose, strongly at {scene.poses[0]}. Joints: {joints}. Markers: {read}.",
        parts,
        key,
    )


def _first(points: Array) -> IntArray:
    """Points (k, 3) or (m, k, 3), m, at the first pose, mm."""
    return whole_mm(points if points.ndim == 2 else points[0])


def _stage(scene: ArmScene, sheet: Sheet) -> Iterator[Markup]:
    """Floor and obstacles."""
    around = scene.around
    yield sheet.lines("arm-floor", around.floor)
    yield sheet.lines("arm-foot", [around.foot])
    for own in around.obstacles:
        yield from _lines(own, sheet)
        yield from _dots(own, sheet)
        yield sheet.words("arm-label", _first(own.label)[0], own.words)


def _lines(own: SceneObject, sheet: Sheet) -> Iterator[Markup]:
    if own.lines:
        yield sheet.lines(f"arm-{own.kind}", map(_first, own.lines))


def _dots(own: SceneObject, sheet: Sheet) -> Iterator[Markup]:
    if len(dots := _first(own.dots)):
        px = 0.0 if own.radius else DOT[own.kind]
        yield sheet.dots(f"arm-{own.kind}", dots, px, round(1e3 * own.radius))


def _all_arms(scene: ArmScene, sheet: Sheet) -> Iterator[Markup]:
    """All poses faintly, each from the last point on that all have in common."""
    opacity = round(min(1.0, (_FAINT / len(scene.poses)) ** 0.5), 2)
    for way in (scene.chain, *scene.branches.values()):
        moves = (way != way[:1]).any(axis=(0, 2))
        moving = way[:, max(0, int(moves.argmax()) - 1) :]
        yield sheet.lines("arm-all", moving, opacity=opacity)
        yield sheet.lines("arm-tips", moving[:, -1:], "h0", opacity)


def _arm(scene: ArmScene, sheet: Sheet) -> Iterator[Markup]:
    """The arm at the first pose, with its shadow and the base frame."""
    chain = scene.chain[0]
    yield sheet.lines("arm-shadow", [chain * _FLOOR])
    yield _drop(sheet, chain[-1])
    yield sheet.rods(
        "arm-shape" if scene.shaped else "arm-links",
        [body.ends[0] for body in scene.bodies],
        [body.radius for body in scene.bodies],
        ("arm-rim", "arm-body"),
    )
    if scene.shaped:
        yield sheet.lines("arm-chain", [chain])
    yield sheet.dots("arm-joint", chain[:-1], _JOINT)
    origin, *ends = np.eye(4, 3, -1, dtype=int) * scene.around.step
    yield from _triad(sheet, origin, ends, "XYZ", "arm-base-axis")


def _branches(scene: ArmScene, sheet: Sheet) -> Iterator[Markup]:
    """The ways to other tips, with their shadows and the names of these."""
    for link, points in scene.branches.items():
        way = points[0]
        yield sheet.lines("arm-shadow", [way * _FLOOR])
        if scene.shaped:
            yield sheet.lines("arm-chain", [way])
        yield sheet.dots("arm-joint", way[:-1], _JOINT)
        yield sheet.words("arm-label", way[-1], link, down=14)


def _drop(sheet: Sheet, point: IntArray) -> Markup:
    """From a point down to the floor."""
    return sheet.lines("arm-drop", [np.stack([point, point * _FLOOR])])


def _triad(
    sheet: Sheet, origin: IntArray, ends: Iterable[IntArray], names: str, kind: str
) -> Iterator[Markup]:
    """Axes with their letters; one that is seen end on has none."""
    for end, name in zip(ends, names, strict=True):
        yield sheet.lines(kind, [np.stack([origin, end])])
        yield sheet.words(f"{kind}-name", end, name, 4, (origin, 8), least=20)


def _sight(scene: ArmScene, sheet: Sheet) -> Iterator[Markup]:
    """Lines from the markers to the instrument, or towards it, where it stands far off."""
    around, points = scene.around, scene.marker_points[0]
    if around.instrument is None:
        return
    ends = np.broadcast_to(around.instrument, points.shape)
    if around.far:
        away = around.instrument - points
        length = np.linalg.norm(away, axis=-1, keepdims=True)
        ends = np.rint(points + _SIGHT * around.step / length * away).astype(int)
    for j, line in enumerate(np.stack([points, ends], axis=1)):
        yield sheet.lines("arm-blocked" if j in scene.lost(0) else "arm-sight", [line])
    if around.far:
        far = float(np.linalg.norm(around.instrument)) / 1e3
        yield sheet.words("arm-label", ends[0], f"instrument {far:.1f} m from base")
        return
    yield _drop(sheet, around.instrument)
    yield sheet.dots("arm-instrument", around.instrument[None], 7)
    yield sheet.lines("arm-instrument", [around.instrument[None]], _TARGET)
    yield sheet.words("arm-label", around.instrument, "instrument", down=-17)


def _fixtures(scene: ArmScene, sheet: Sheet) -> Iterator[Markup]:
    """Cameras with what they see, boards, sockets, what is touched, wires to the marker."""
    names: list[Markup] = []
    for own in scene.fixtures:
        label = _first(own.label)
        yield from _lines(own, sheet)
        if own.stem is not None:
            yield sheet.lines("arm-tool", [np.concatenate([_first(own.stem), label])])
        if own.kind in DROPPED:
            yield _drop(sheet, label[0])
        yield from _dots(own, sheet)
        if own.words:
            names.append(sheet.words("arm-label", label[0], own.words, down=-10))
    yield from names


def _markers(scene: ArmScene, sheet: Sheet) -> Iterator[Markup]:
    """Markers on their stems; a lost one is hollow and crossed."""
    each = zip(scene.markers, scene.marker_points[0], scene.stems[0], strict=True)
    for j, (name, point, tip) in enumerate(each):
        yield sheet.lines("arm-tool", [np.stack([tip, point])])
        if j in scene.lost(0):
            yield sheet.dots("arm-marker arm-hidden", point[None], MARKER)
            yield sheet.lines("arm-hidden", [point[None]], CROSS)
        else:
            yield sheet.dots("arm-marker", point[None], MARKER)
        yield sheet.words("arm-name", point, name, 4, (tip, 13))
