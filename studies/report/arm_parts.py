"""What the picture of the arm shows, in its order: the only place that says so."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import accumulate, product
from typing import NamedTuple

import numpy as np

from calib.arrays import IntArray
from studies.report.arm_drawing import ArmPicture, Dot, DrawnPart, Rods, Run, Stroke, Text
from studies.report.arm_scene import ArmScene, shared
from studies.report.surroundings import ArmSurroundings, Outline

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


class _Stands(NamedTuple):
    """What stands where. As points: arrays of shape (m or 1, n, 3), mm; as numbers: (n,)."""

    arm: IntArray
    floor: IntArray
    foot: IntArray
    ruler: IntArray
    outlines: IntArray
    base: IntArray
    tip: IntArray
    instrument: IntArray
    sights: IntArray
    fixtures: IntArray


def picture(scene: ArmScene) -> ArmPicture:
    """The arm at each pose, faintly at all others, and what stands around it."""
    stands = _stands(scene)
    count = len(scene.poses)
    placed = [np.broadcast_to(points, (count, *points.shape[1:])) for points in stands]
    points, number, still = shared(np.concatenate(placed, axis=1))
    at = _Stands(*_cut(number, [points.shape[1] for points in stands]))
    parts = (
        *_stage(scene, at), *_all_arms(scene, at), *_arm(scene, at), *_fixtures(scene, at),
        *_markers(scene, at),
    )  # fmt: skip
    return ArmPicture(
        title=f"{scene.name}: the arm at {count} {'pose' if count == 1 else 'poses'}",
        description=_description(scene),
        points=points,
        still=still,
        tip=_chain(scene, at)[-1],
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


def _stands(scene: ArmScene) -> _Stands:
    """All points of the picture."""
    around, tip = scene.around, scene.points[:, scene.chain[-1], None]
    outlines = [points for o in around.outlines for points in (*o.lines, o.centre[None])]
    seen_from = np.zeros((0, 3), int) if around.instrument is None else around.instrument[None]
    return _Stands(
        arm=scene.points,
        floor=around.floor.reshape(1, -1, 3),
        foot=around.foot[None],
        ruler=_ruler(around)[None],
        outlines=np.concatenate([np.zeros((0, 3), int), *outlines])[None],
        base=np.concatenate([np.zeros((1, 3), int), np.eye(3, dtype=int) * around.step])[None],
        tip=tip + np.rint(scene.tip_axes * around.step * _TIP_AXIS).astype(int),
        instrument=seen_from[None],
        sights=_sights(scene),
        fixtures=_fixture_points(scene),
    )


def _fixture_points(scene: ArmScene) -> IntArray:
    """Points of all fixtures side by side, (m, n, 3) mm."""
    count = len(scene.poses)
    all_points = [points for own in scene.fixtures for points in own.points]
    spread = [np.broadcast_to(own, (count, *own.shape[1:])) for own in all_points]
    return np.concatenate([np.zeros((count, 0, 3), dtype=int), *spread], axis=1)


def _ruler(around: ArmSurroundings) -> IntArray:
    """Both sides of the floor cell at each corner of the floor, both from the corner, (16, 3) mm."""
    low, high = around.floor.min(axis=(0, 1)), around.floor.max(axis=(0, 1))
    corners = np.array([(x, y, 0) for x, y in product((low[0], high[0]), (low[1], high[1]))])
    inward = np.where(corners == low, around.step, -around.step)
    ends = corners[:, None] + np.eye(3, dtype=int)[:2] * inward[:, None]
    return np.stack([np.broadcast_to(corners[:, None], ends.shape), ends], axis=2).reshape(-1, 3)


def _sights(scene: ArmScene) -> IntArray:
    """Ends of the lines of sight to a far instrument, (m, M, 3) mm; none where it is near."""
    markers = scene.points[:, scene.marker_points]
    if scene.around.instrument is None or not scene.around.far:
        return markers[:, :0]
    away = scene.around.instrument - markers
    share = _SIGHT * scene.around.step / np.linalg.norm(away, axis=-1, keepdims=True)
    return np.asarray(np.rint(markers + share * away), dtype=int)


def _cut(numbers: IntArray, lengths: Iterable[int]) -> list[IntArray]:
    """Numbers in pieces of these lengths."""
    return np.split(numbers, list(accumulate(lengths)))[:-1]


def _pairs(numbers: IntArray) -> tuple[Run, ...]:
    return tuple((int(a), int(b)) for a, b in numbers.reshape(-1, 2))


def _run(numbers: Iterable[int]) -> Run:
    return tuple(int(c) for c in numbers)


def _chain(scene: ArmScene, at: _Stands) -> Run:
    return _run(at.arm[list(scene.chain)])


def _stage(scene: ArmScene, at: _Stands) -> Iterator[DrawnPart]:
    """Floor with its scale, and obstacles."""
    yield Stroke("arm-floor", _pairs(at.floor))
    yield Stroke("arm-foot", (_run(at.foot),))
    yield Stroke("arm-scale", _pairs(at.ruler), lowest=True)
    length = f"{scene.around.step} mm"
    yield Text("arm-label", _pairs(at.ruler), length, down=15, lowest=True)
    outlines = scene.around.outlines
    counts = [sum(map(len, outline.lines)) + 1 for outline in outlines]
    for outline, numbers in zip(outlines, _cut(at.outlines, counts), strict=True):
        yield from _obstacle(outline, numbers)


def _obstacle(outline: Outline, numbers: IntArray) -> Iterator[DrawnPart]:
    kind = "arm-plane" if outline.plane else "arm-solid"
    *lines, centre = map(_run, _cut(numbers, [*map(len, outline.lines), 1]))
    yield Stroke(kind, tuple(lines))
    if outline.radius:
        yield Dot(kind, (centre,), mm=outline.radius)
    yield Text("arm-label", (centre,), outline.name)


def _all_arms(scene: ArmScene, at: _Stands) -> Iterator[DrawnPart]:
    """All poses faintly, each from the last point on that all have in common."""
    first = next((i for i, point in enumerate(scene.chain) if point >= scene.still), 0)
    moving = _chain(scene, at)[max(0, first - 1) :]
    opacity = round(min(1.0, (_FAINT / len(scene.poses)) ** 0.5), 2)
    yield Stroke("arm-all", (moving,), every=True, opacity=opacity)
    yield Stroke("arm-tips", (moving[-1:],), tail="h0", every=True, opacity=opacity)


def _arm(scene: ArmScene, at: _Stands) -> Iterator[DrawnPart]:
    """The arm at the picked pose, with its shadow, both frames and the lines of sight."""
    chain = _chain(scene, at)
    tip = chain[-1]
    yield Stroke("arm-shadow", (_run(~c for c in chain),))
    yield Stroke("arm-drop", ((tip, ~tip),))
    yield Rods(
        "arm-shape" if scene.shaped else "arm-links",
        tuple(_run(at.arm[[body.start, body.end]]) for body in scene.bodies),
        mm=tuple(body.radius for body in scene.bodies),
        layers=(("arm-rim", 2), ("arm-body", 0)),
    )
    if scene.shaped:
        yield Stroke("arm-chain", (chain,))
    yield Dot("arm-joint", (chain[:-1],), px=_JOINT)
    origin, *ends = _run(at.base)
    yield from _triad(origin, ends, "XYZ", "arm-base-axis")
    yield from _sight(scene, at)
    yield from _triad(tip, _run(at.tip), "xyz", "arm-tip-axis")


def _triad(origin: int, ends: Iterable[int], names: str, kind: str) -> Iterator[DrawnPart]:
    """Axes with their letters; one that is seen end on has none."""
    for end, name in zip(ends, names, strict=True):
        yield Stroke(kind, ((origin, end),))
        yield Text(f"{kind}-name", ((end,),), name, beyond=(origin, 8), least=20, down=4)


def _sight(scene: ArmScene, at: _Stands) -> Iterator[DrawnPart]:
    """Lines from the markers to the instrument, or towards it, where it stands far off."""
    around = scene.around
    if around.instrument is None:
        return
    markers = _run(at.arm[list(scene.marker_points)])
    ends = _run(at.sights) if around.far else _run(at.instrument) * len(markers)
    for j, line in enumerate(zip(markers, ends, strict=True)):
        yield from _seen_or_lost(
            scene, j, [Stroke("arm-sight", (line,))], [Stroke("arm-blocked", (line,))]
        )
    if around.far:
        away = float(np.linalg.norm(around.instrument)) / 1e3
        yield Text("arm-label", (ends[:1],), f"instrument {away:.1f} m from base")
        return
    place = _run(at.instrument)
    yield Stroke("arm-drop", ((place[0], ~place[0]),))
    yield Dot("arm-instrument", (place,), px=7)
    yield Stroke("arm-instrument", (place,), tail=_TARGET)
    yield Text("arm-label", (place,), "instrument", down=-17)


def _fixtures(scene: ArmScene, at: _Stands) -> Iterator[DrawnPart]:
    """Cameras with what they see, boards, sockets, what is touched, wires to the marker."""
    counts = [sum(points.shape[1] for points in own.points) for own in scene.fixtures]
    names: list[DrawnPart] = []
    for own, numbers in zip(scene.fixtures, _cut(at.fixtures, counts), strict=True):
        *lines, dots, label = map(_run, _cut(numbers, [p.shape[1] for p in own.points]))
        kind = f"arm-{own.kind}"
        if lines:
            yield Stroke(kind, tuple(lines))
        if own.label.shape[0] > 1:
            yield Stroke("arm-tool", ((_chain(scene, at)[-1], label[0]),))
        if own.dropped:
            yield Stroke("arm-drop", ((label[0], ~label[0]),))
        if dots:
            yield Dot(kind, (dots,), mm=own.radius, px=0.0 if own.radius else DOT[own.kind])
        if own.words:
            names.append(Text("arm-label", (label,), own.words, down=-10))
    yield from names


def _markers(scene: ArmScene, at: _Stands) -> Iterator[DrawnPart]:
    """Markers on their stems; a lost one is hollow and crossed."""
    tip = _chain(scene, at)[-1]
    for j, (name, column) in enumerate(zip(scene.markers, scene.marker_points, strict=True)):
        place = _run([at.arm[column]])
        yield Stroke("arm-tool", ((tip, *place),))
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
