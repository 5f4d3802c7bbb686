"""The figure of the arm: what it shows, in its order, what turns it, and how to read it."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from dataclasses import fields, replace
from typing import Any

import numpy as np
from markupsafe import Markup

from calib.arrays import Array, IntArray
from studies.report.arm_drawing import (
    START,
    ArmPicture,
    Dot,
    DrawnPart,
    Rods,
    Run,
    Stroke,
    Text,
    drawing,
)
from studies.report.arm_instruments import DROPPED
from studies.report.arm_scene import ArmScene
from studies.report.surroundings import SceneObject, whole_mm


def figure_html(scene: ArmScene, key: str = "arm") -> Markup:
    """The figure: drawing, controls, a line about the pose shown, legend, and the data for the script.

    key : str, begins the identifiers in it; one of its own for each figure of a page
    """
    joints, markers = scene.readout(0)
    shown = picture(scene)
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
        drawing=drawing(shown, key),
        pose=scene.poses[0],
        joints=joints,
        markers=markers,
        legend=_legend(scene),
        caption=_caption(scene),
        data=_in_script(figure_data(scene, shown)),
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
    if scene.hidden:
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


def figure_data(scene: ArmScene, shown: ArmPicture) -> dict[str, Any]:
    """What the script draws from, in mm and the shown units, and what it says of each pose."""
    told = [scene.readout(i)[1] for i in range(len(scene.poses))]
    states = list(dict.fromkeys(zip(told, shown.lost, strict=True)))
    number = {state: i for i, state in enumerate(states)}
    return {
        "poses": scene.poses,
        "day": scene.day,
        "joints": scene.joint_words,
        "values": scene.values.tolist(),
        "states": states,
        "state": [number[state] for state in zip(told, shown.lost, strict=True)],
        # Where each point is at each pose, one after the other; once, where it stands still.
        "points": [
            (own if (own != own[0]).any() else own[0]).ravel().tolist()
            for own in shown.points.swapaxes(0, 1)
        ],
        "tip": shown.tip,
        "frame": shown.frame.ravel().tolist(),
        "view": [START.azimuth, START.elevation],
        "parts": [_plain(part) for part in shown.parts],
    }


def _plain(part: DrawnPart) -> dict[str, Any]:
    """A part by its kind, and what of it is not as usual."""
    said = {f.name: v for f in fields(part) if (v := getattr(part, f.name)) != f.default}
    return {"kind": type(part).__name__, **said}


def _in_script(data: Any) -> Markup:
    """JSON that no text in it can end: neither ``</script>`` nor ``<!--`` nor an entity is left."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    for sign in "<>&":
        text = text.replace(sign, f"\\u{ord(sign):04x}")
    return Markup(text)  # noqa: S704


CROSS = "m-6 -6l12 12m-12 0l12 -12"
MARKER = 4.5  # px, radius
DOT = {
    "camera": 3.5, "board": 1.6, "frame": 3.0, "socket": 6.0, "touched": 1.5,
    "wire": 4.0, "instrument": 6.0,
}  # fmt: skip
_JOINT = 4  # px, radius
_TARGET = "m-11 0h22m-11 -11v22"
_FAINT = 20  # poses; of more, those that are not picked fade
_TIP_AXIS = 0.35  # floor cells
_SIGHT = 3.0  # floor cells of a line of sight whose instrument is not in the picture


class _Canvas:
    """Points of a picture by number, as parts are made; equal ones are one."""

    def __init__(self, rows: int) -> None:
        self._rows = rows
        self._numbers: dict[bytes, int] = {}

    def at(self, points: Array) -> Run:
        """Points (k, 3) or (rows, k, 3), m, one after the other."""
        return self.run(whole_mm(points))

    def run(self, points: IntArray) -> Run:
        """The same in mm."""
        placed = np.broadcast_to(points, (self._rows, *points.shape[-2:])).swapaxes(0, 1)
        return tuple(self._numbers.setdefault(own.tobytes(), len(self._numbers)) for own in placed)

    def runs(self, points: IntArray) -> tuple[Run, ...]:
        """As many runs as there are in an array (l, k, 3) mm of what stands still."""
        return tuple(map(self.run, points))

    @property
    def points(self) -> IntArray:
        """All of them, shape (rows, k, 3), mm."""
        held = np.frombuffer(b"".join(self._numbers), dtype=int)
        return held.reshape(-1, self._rows, 3).swapaxes(0, 1)


def picture(scene: ArmScene) -> ArmPicture:
    """The arm at each pose, faintly at all others, and what stands around it."""
    canvas = _Canvas(len(scene.values))
    chain = canvas.run(scene.chain)
    markers, stems = canvas.run(scene.marker_points), canvas.run(scene.stems)
    tip_axes = np.rint(scene.tip_axes * scene.around.step * _TIP_AXIS).astype(int)
    parts = (
        *_stage(scene, canvas),
        *_all_arms(scene, canvas),
        *_arm(scene, canvas, chain),
        *_branches(scene, canvas),
        *_sight(scene, canvas, markers),
        *_triad(chain[-1], canvas.run(scene.chain[:, -1:] + tip_axes), "xyz", "arm-tip-axis"),
        *_fixtures(scene, canvas),
        *_markers(scene, markers, stems),
    )
    count, (joints, read) = len(scene.poses), scene.readout(0)
    return ArmPicture(
        title=f"{scene.name}: the arm at {count} {'pose' if count == 1 else 'poses'}",
        description=f"The arm in its base frame over a floor with cells of {scene.around.step} mm: "
        f"faintly at every pose, strongly at {scene.poses[0]}. Joints: {joints}. Markers: {read}.",
        points=canvas.points,
        tip=chain[-1],
        lost=tuple(scene.lost(i) for i in range(count)),
        frame=scene.around.frame,
        parts=parts,
    )


def _stage(scene: ArmScene, canvas: _Canvas) -> Iterator[DrawnPart]:
    """Floor and obstacles."""
    around = scene.around
    yield Stroke("arm-floor", canvas.runs(around.floor))
    yield Stroke("arm-foot", (canvas.run(around.foot),))
    for own in around.obstacles:
        yield from _lines(own, canvas)
        yield from _dots(own, canvas)
        yield Text("arm-label", (canvas.at(own.label),), own.words)


def _lines(own: SceneObject, canvas: _Canvas) -> Iterator[DrawnPart]:
    if own.lines:
        yield Stroke(f"arm-{own.kind}", tuple(map(canvas.at, own.lines)))


def _dots(own: SceneObject, canvas: _Canvas) -> Iterator[DrawnPart]:
    if dots := canvas.at(own.dots):
        px = 0.0 if own.radius else DOT[own.kind]
        yield Dot(f"arm-{own.kind}", (dots,), mm=round(1e3 * own.radius), px=px)


def _all_arms(scene: ArmScene, canvas: _Canvas) -> Iterator[DrawnPart]:
    """All poses faintly, each from the last point on that all have in common."""
    opacity = round(min(1.0, (_FAINT / len(scene.poses)) ** 0.5), 2)
    for way in (scene.chain, *scene.branches.values()):
        moves = (way != way[:1]).any(axis=(0, 2))
        moving = canvas.run(way)[max(0, int(moves.argmax()) - 1) :]
        yield Stroke("arm-all", (moving,), every=True, opacity=opacity)
        yield Stroke("arm-tips", (moving[-1:],), tail="h0", every=True, opacity=opacity)


def _arm(scene: ArmScene, canvas: _Canvas, chain: Run) -> Iterator[DrawnPart]:
    """The arm at the picked pose, with its shadow and the base frame."""
    yield Stroke("arm-shadow", (tuple(~c for c in chain),))
    yield Stroke("arm-drop", ((chain[-1], ~chain[-1]),))
    yield Rods(
        "arm-shape" if scene.shaped else "arm-links",
        tuple(canvas.run(body.ends) for body in scene.bodies),
        mm=tuple(body.radius for body in scene.bodies),
        layers=(("arm-rim", 2), ("arm-body", 0)),
    )
    if scene.shaped:
        yield Stroke("arm-chain", (chain,))
    yield Dot("arm-joint", (chain[:-1],), px=_JOINT)
    origin, *ends = canvas.run(np.eye(4, 3, -1, dtype=int) * scene.around.step)
    yield from _triad(origin, ends, "XYZ", "arm-base-axis")


def _branches(scene: ArmScene, canvas: _Canvas) -> Iterator[DrawnPart]:
    """The ways to other tips, with their shadows and the names of these."""
    for link, points in scene.branches.items():
        way = canvas.run(points)
        yield Stroke("arm-shadow", (tuple(~c for c in way),))
        if scene.shaped:
            yield Stroke("arm-chain", (way,))
        yield Dot("arm-joint", (way[:-1],), px=_JOINT)
        yield Text("arm-label", (way[-1:],), link, down=14)


def _triad(origin: int, ends: Iterable[int], names: str, kind: str) -> Iterator[DrawnPart]:
    """Axes with their letters; one that is seen end on has none."""
    for end, name in zip(ends, names, strict=True):
        yield Stroke(kind, ((origin, end),))
        yield Text(f"{kind}-name", ((end,),), name, beyond=(origin, 8), least=20, down=4)


def _sight(scene: ArmScene, canvas: _Canvas, markers: Run) -> Iterator[DrawnPart]:
    """Lines from the markers to the instrument, or towards it, where it stands far off."""
    around = scene.around
    if around.instrument is None:
        return
    if around.far:
        away = around.instrument - scene.marker_points
        length = np.linalg.norm(away, axis=-1, keepdims=True)
        sights = scene.marker_points + _SIGHT * around.step / length * away
        ends = canvas.run(np.rint(sights).astype(int))
    else:
        ends = canvas.run(around.instrument[None]) * len(markers)
    for j, line in enumerate(zip(markers, ends, strict=True)):
        yield from _seen_or_lost(
            scene, j, [Stroke("arm-sight", (line,))], [Stroke("arm-blocked", (line,))]
        )
    if around.far:
        far = float(np.linalg.norm(around.instrument)) / 1e3
        yield Text("arm-label", (ends[:1],), f"instrument {far:.1f} m from base")
        return
    place = canvas.run(around.instrument[None])
    yield Stroke("arm-drop", ((place[0], ~place[0]),))
    yield Dot("arm-instrument", (place,), px=7)
    yield Stroke("arm-instrument", (place,), tail=_TARGET)
    yield Text("arm-label", (place,), "instrument", down=-17)


def _fixtures(scene: ArmScene, canvas: _Canvas) -> Iterator[DrawnPart]:
    """Cameras with what they see, boards, sockets, what is touched, wires to the marker."""
    names: list[DrawnPart] = []
    for own in scene.fixtures:
        label = canvas.at(own.label)
        yield from _lines(own, canvas)
        if own.stem is not None:
            yield Stroke("arm-tool", ((*canvas.at(own.stem), *label),))
        if own.kind in DROPPED:
            yield Stroke("arm-drop", ((label[0], ~label[0]),))
        yield from _dots(own, canvas)
        if own.words:
            names.append(Text("arm-label", (label,), own.words, down=-10))
    yield from names


def _markers(scene: ArmScene, points: Run, stems: Run) -> Iterator[DrawnPart]:
    """Markers on their stems; a lost one is hollow and crossed."""
    for j, (name, point, tip) in enumerate(zip(scene.markers, points, stems, strict=True)):
        place = (point,)
        yield Stroke("arm-tool", ((tip, point),))
        crossed = [
            Dot("arm-marker arm-hidden", (place,), px=MARKER),
            Stroke("arm-hidden", (place,), tail=CROSS),
        ]
        yield from _seen_or_lost(scene, j, [Dot("arm-marker", (place,), px=MARKER)], crossed)
        yield Text("arm-name", (place,), name, beyond=(tip, 13), down=4)


def _seen_or_lost(
    scene: ArmScene, marker: int, seen: list[DrawnPart], lost: list[DrawnPart]
) -> Iterator[DrawnPart]:
    """The one at poses where a marker is seen, the other where it is lost."""
    times = sum((i, marker) in scene.hidden for i in range(len(scene.poses)))
    if times < len(scene.poses):
        yield from (replace(part, when=(marker, False)) if times else part for part in seen)
    if times:
        yield from (replace(part, when=(marker, True)) for part in lost)
