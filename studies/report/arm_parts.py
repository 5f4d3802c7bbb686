"""What the picture of the arm shows, in its order: the only place that says so."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from calib.arrays import IntArray
from studies.report.arm_drawing import ArmPicture, Dot, DrawnPart, Rods, Run, Stroke, Text
from studies.report.arm_instruments import DROPPED
from studies.report.arm_scene import ArmScene
from studies.report.surroundings import SceneObject

CROSS = "m-6 -6l12 12m-12 0l12 -12"
MARKER = 4.5  # px, radius
DOT = {
    "camera": 3.5, "board": 1.6, "frame": 3.0, "socket": 6.0, "sphere": 0.0, "touched": 1.5,
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

    def run(self, points: IntArray) -> Run:
        """Points (k, 3), (1, k, 3) or (rows, k, 3) mm, one after the other."""
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
    parts = (
        *_stage(scene, canvas),
        *_all_arms(scene, canvas),
        *_arm(scene, canvas, chain),
        *_branches(scene, canvas),
        *_sight(scene, canvas, markers),
        *_tip(scene, canvas, chain[-1]),
        *_fixtures(scene, canvas),
        *_markers(scene, markers, stems),
    )
    count = len(scene.poses)
    return ArmPicture(
        title=f"{scene.name}: the arm at {count} {'pose' if count == 1 else 'poses'}",
        description=_description(scene),
        points=canvas.points,
        tip=chain[-1],
        lost=tuple(scene.lost(i) for i in range(count)),
        frame=scene.around.frame,
        parts=parts,
    )


def _description(scene: ArmScene) -> str:
    """The drawing in words, for who does not see it."""
    joints, markers = scene.readout(0)
    return (
        f"The arm in its base frame over a floor with cells of {scene.around.step} mm: faintly at "
        f"every pose, strongly at {scene.poses[0]}. Joints: {joints}. Markers: {markers}."
    )


def _sights(scene: ArmScene, instrument: IntArray) -> IntArray:
    """Ends of the lines of sight to a far instrument, (m, M, 3) mm."""
    away = instrument - scene.marker_points
    share = _SIGHT * scene.around.step / np.linalg.norm(away, axis=-1, keepdims=True)
    return np.asarray(np.rint(scene.marker_points + share * away), dtype=int)


def _stage(scene: ArmScene, canvas: _Canvas) -> Iterator[DrawnPart]:
    """Floor and obstacles."""
    around = scene.around
    yield Stroke("arm-floor", canvas.runs(around.floor))
    yield Stroke("arm-foot", (canvas.run(around.foot),))
    for own in around.obstacles:
        yield from _lines(own, canvas)
        yield from _dots(own, canvas)
        yield Text("arm-label", (canvas.run(own.label),), own.words)


def _lines(own: SceneObject, canvas: _Canvas) -> Iterator[DrawnPart]:
    if own.lines:
        yield Stroke(f"arm-{own.kind}", tuple(map(canvas.run, own.lines)))


def _dots(own: SceneObject, canvas: _Canvas) -> Iterator[DrawnPart]:
    if dots := canvas.run(own.dots):
        px = 0.0 if own.radius else DOT[own.kind]
        yield Dot(f"arm-{own.kind}", (dots,), mm=own.radius, px=px)


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


def _tip(scene: ArmScene, canvas: _Canvas, tip: int) -> Iterator[DrawnPart]:
    """The tip's frame."""
    axes = np.rint(scene.tip_axes * scene.around.step * _TIP_AXIS).astype(int)
    yield from _triad(tip, canvas.run(scene.chain[:, -1:] + axes), "xyz", "arm-tip-axis")


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
        ends = canvas.run(_sights(scene, around.instrument))
    else:
        ends = canvas.run(around.instrument[None]) * len(markers)
    for j, line in enumerate(zip(markers, ends, strict=True)):
        yield from _seen_or_lost(
            scene, j, [Stroke("arm-sight", (line,))], [Stroke("arm-blocked", (line,))]
        )
    if around.far:
        away = float(np.linalg.norm(around.instrument)) / 1e3
        yield Text("arm-label", (ends[:1],), f"instrument {away:.1f} m from base")
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
        label = canvas.run(own.label)
        yield from _lines(own, canvas)
        if own.stem is not None:
            yield Stroke("arm-tool", ((*canvas.run(own.stem), *label),))
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
