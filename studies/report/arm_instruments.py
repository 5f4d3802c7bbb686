"""Instruments and what they read, as lines around and on the arm: whole millimetres, base frame."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import takewhile
from typing import TypeAlias

import numpy as np

from calib.arm.se3 import across, rotate, so3_exp
from calib.arrays import Array, IntArray
from calib.cell import Cell
from calib.effects.base import Base
from calib.errors import CalibError
from calib.identification.start import initial_values
from calib.instruments import (
    ArmCamera,
    Camera,
    Distance,
    FixedCamera,
    Instrument,
    Plane,
    Pose,
    Socket,
    Sphere,
    Tracker,
)
from calib.model.build import build, parse_effect
from calib.model.model import Model
from calib.poses import Measurements, Poses
from doe.constraints import Scene
from studies.report.surroundings import (
    NO_POINTS,
    SceneObject,
    grid_lines,
    hull,
    hull_runs,
    ring,
    whole_mm,
)

_NEAR = 3.0  # arm lengths; what stands farther from the middle is not drawn


DROPPED = ("camera", "socket", "sphere", "wire", "instrument")
"""Kinds whose place on the floor is shown."""


@dataclass(frozen=True, eq=False)
class InstrumentPlaces:
    """Where instruments stand and markers sit, as given or as the readings tell.

    places : dict, name of an instrument, or of one of its sites -> place (u,)
    markers : ndarray, shape (M, 3), m, tip frame
    """

    places: Mapping[str, Array] = field(default_factory=dict)
    markers: Array = field(default_factory=lambda: np.zeros((0, 3)))


def instrument_places(cell: Cell, plan: Poses | Measurements) -> InstrumentPlaces:
    """From measured readings as an identification starts; else what the cell says, and no more."""
    known = {name: i.guess_at(name) for i in cell.instruments if _given(i) for name in i.names}
    if not isinstance(plan, Measurements) or not placing(cell):
        return InstrumentPlaces(known, cell.markers)
    try:
        model, values = started(cell, plan)
    except CalibError:  # too little to tell
        return InstrumentPlaces(known, cell.markers)
    found = {
        (effect.where if effect.of.sites else effect.of.name): values[part]
        for effect, part in model.parts
        if isinstance(effect, Base) and effect.station in (None, 0)
    }
    return InstrumentPlaces({**known, **found}, model.marker_positions(values))


def placing(cell: Cell) -> tuple[str, ...]:
    """Effects of the cell that say where instruments stand and markers sit."""
    return tuple(e for e in cell.effects if parse_effect(e)[0] in ("base", "tool"))


def started(cell: Cell, data: Measurements) -> tuple[Model, Array]:
    """The model of these effects alone, and the values from which an identification starts."""
    model = build(replace(cell, effects=placing(cell)), data.poses).model
    return model, initial_values(model, data)


def on_tips(scene: Scene, points: Array, frames: IntArray) -> Array:
    """Points (k, 3), m, of tip frames (k,) at every pose, (m, k, 3), m, base axes."""
    return rotate(scene.frames.R[:, frames], points) + scene.origins[:, frames]


def _given(instrument: Instrument) -> bool:
    if isinstance(instrument, Camera):
        return instrument.standing is not None
    if isinstance(instrument, Distance):
        return instrument.anchor is not None
    return instrument.touches and not instrument.unforeseen


def within(
    drawn: Sequence[SceneObject], frame: IntArray, length: float
) -> tuple[tuple[SceneObject, ...], dict[str, float], IntArray]:
    """Those near an arm of some length [mm], how far off [m] the others stand, and the frame of all."""
    middle = (frame.min(axis=0) + frame.max(axis=0)) / 2.0
    kept: list[SceneObject] = []
    beyond: dict[str, float] = {}
    for own in drawn:
        away = np.linalg.norm(own.label - middle, axis=-1)
        if own.label.shape[0] == 1 and float(away.max()) > _NEAR * length:
            beyond[own.name] = float(np.linalg.norm(own.label[0, 0])) / 1e3
        else:
            kept.append(own)
    points = [p.reshape(-1, 3) for own in kept for p in own.points]
    points += [
        own.label.reshape(-1, 3) * np.array([1, 1, 0]) for own in kept if own.kind in DROPPED
    ]
    return tuple(kept), beyond, hull(np.concatenate([frame, *points])) if points else frame


_CONE, _TRIAD, _PATCH = 0.16, 0.07, 0.22  # arm lengths
_CLOSE = 0.1  # arm lengths; sockets nearer than this have one name
_DOTS = 60  # points of a board that are drawn one by one, at most
_SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.0, 0.0]])
_UP = np.array([[0.4, 0.0], [0.5, -0.12], [0.6, 0.0]])  # of a camera's image


def fixtures(
    cell: Cell, plan: Poses | Measurements, scene: Scene, found: InstrumentPlaces, length: float
) -> Iterator[SceneObject]:
    """All that can be drawn, of an arm of some length, m."""
    sketch = _Sketch(cell, plan, scene, found, length)
    seen: set[tuple[str, str]] = set()  # two cameras see one board
    for instrument, part in cell.channels.blocks:
        draw = next(draw for kind, draw in _DRAWN.items() if isinstance(instrument, kind))
        for own in draw(sketch, instrument, part):
            if (own.kind, own.name) not in seen:
                yield own
            seen.add((own.kind, own.name))


@dataclass(frozen=True, eq=False)
class _Sketch:
    cell: Cell
    plan: Poses | Measurements
    scene: Scene
    found: InstrumentPlaces
    length: float

    def on(self, frame: int, points: Array) -> Array:
        """Points (k, 3), m, of a tip frame at every pose, (m, k, 3), m."""
        return on_tips(self.scene, points, np.full(len(points), frame))

    def under(self, body: slice | None) -> int | None:
        """Frame of the tip that carries some markers; None for none of them."""
        return None if body is None else int(self.cell.marker_frames[body][0])

    def markers(self, instrument: Instrument) -> Array:
        """Markers that an instrument reads at every pose, (m, k, 3), m."""
        read = instrument.read_of(len(self.found.markers))
        return on_tips(self.scene, self.found.markers[read], self.cell.marker_frames[read])

    def placed(self, kind: str, name: str, frame: int | None, lines: list[Array], dots: Array,
               label: Array | None = None) -> SceneObject:  # fmt: skip
        """Lines (k, 3) and dots (n, 3), m, of a tip frame, or of the base where there is none.

        label : ndarray, shape (1, 3), m, where the name stands; at the first dot without
        """
        label = dots[:1] if label is None else label
        if frame is None:
            return replace(_still(kind, name, lines, dots), label=whole_mm(label)[None])
        stem = whole_mm(self.scene.origins[:, [frame]])
        moved = [self.on(frame, line) for line in lines]
        riding = _moving(kind, name, moved, self.on(frame, dots), self.on(frame, label))
        return replace(riding, stem=stem)

    def seen(self, part: slice) -> Array:
        """Which of its readings there are, (m, k)."""
        count = part.stop - part.start
        if isinstance(self.plan, Measurements):
            return np.asarray(self.plan.seen[:, part])
        return np.ones((len(self.scene), count), dtype=bool)

    def cone(self, camera: Camera, centre: Array, axes: Array) -> list[Array]:
        """What a camera sees, up to some distance: axes (3, 3) by rows; its lines (k, 3), m."""
        fx, fy, cx, cy = camera.lens.values[:4]
        size = np.array([2.0 * cx, 2.0 * cy]) if camera.image is None else camera.image

        def at(shares: Array) -> Array:
            ideal = (shares * size - [cx, cy]) / [fx, fy]
            rays = np.column_stack([ideal, np.ones(len(ideal))])
            return np.asarray(centre + rays @ axes * _CONE * self.length)

        rim = at(_SQUARE)
        return [rim, at(_UP), *(np.stack([centre, corner]) for corner in rim[:4])]


def _still(
    kind: str, name: str, lines: list[Array], dots: Array, radius: float = 0.0
) -> SceneObject:
    """What stands in the world: lines (k, 3) and dots (n, 3), m, the first dot bears the name."""
    own = whole_mm(dots)[None]
    mm = tuple(whole_mm(line)[None] for line in lines)
    return SceneObject(kind, name, mm, own, own[:, :1], round(radius * 1e3), name)


def _moving(kind: str, name: str, lines: list[Array], dots: Array, label: Array) -> SceneObject:
    """What moves with the arm: lines (m, k, 3) and dots (m, n, 3), m."""
    mm = tuple(map(whole_mm, lines))
    return SceneObject(kind, name, mm, whole_mm(dots), whole_mm(label), words=name)


def _fixed_camera(sketch: _Sketch, camera: FixedCamera, _: slice) -> Iterator[SceneObject]:
    place = sketch.found.places.get(camera.name)
    if place is not None:
        R = so3_exp(place[3:6])
        centre = -R.T @ place[:3]
        cone, under = sketch.cone(camera, centre, R), sketch.under(camera.seat)
        yield sketch.placed("camera", camera.name, under, cone, centre[None])
    for board in camera.boards:
        part = sketch.cell.bodies[board.name]
        points = sketch.found.markers[part]
        lines = [points[list(run)] for run in hull_runs(board.points)]
        dots = points if len(board.points) <= _DOTS else points[:0]
        middle = points.mean(axis=0, keepdims=True)
        yield sketch.placed("board", board.name, sketch.under(part), lines, dots, middle)


def _arm_camera(sketch: _Sketch, camera: ArmCamera, _: slice) -> Iterator[SceneObject]:
    part = sketch.cell.bodies[camera.name]
    o, x, y = sketch.found.markers[part]
    axes = np.stack([x - o, y - o, np.cross(x - o, y - o)])
    cone = sketch.cone(camera, o, axes)
    yield sketch.placed("camera", camera.name, sketch.under(part), cone, o[None])
    places = sketch.found.places.get(camera.name)
    for k, board in enumerate(camera.boards if places is not None else ()):
        place = places[6 * k : 6 * k + 6] if places is not None else np.zeros(6)
        points = board.points @ so3_exp(place[3:]).T + place[:3]
        own = _still("board", board.name, [points[run] for run in hull_runs(points)], points)
        middle = whole_mm(points.mean(axis=0))[None, None]
        dots = own.dots if len(points) <= _DOTS else NO_POINTS
        yield replace(own, dots=dots, label=middle)


def _bodies(sketch: _Sketch, instrument: Pose, _: slice) -> Iterator[SceneObject]:
    yield from _stand(sketch, instrument, _)
    own = sketch.found.markers[instrument.read_of(len(sketch.found.markers))].reshape(-1, 3, 3)
    names = [
        sketch.cell.marker_names[j] for j in instrument.read_of(len(sketch.found.markers))[::3]
    ]
    for name, (o, x, y) in zip(names, own, strict=True):
        ends = np.stack([x - o, y - o, np.cross(x - o, y - o)]) * _TRIAD * sketch.length
        lines = [np.stack([o, o + end]) for end in ends]
        frame = sketch.under(sketch.cell.bodies[name])
        yield sketch.placed("frame", name, frame, lines, o[None])


def _stand(sketch: _Sketch, instrument: Instrument, _: slice) -> Iterator[SceneObject]:
    """Where its axes stand; one whose place the cell gives is drawn with its lines of sight."""
    place = sketch.found.places.get(instrument.name)
    framed = instrument.unknowns[:6] == Tracker.unknowns
    if place is None or instrument.position is not None or not framed:
        return
    R, p = Tracker.placement(place[:6])
    ends = R * _TRIAD * sketch.length
    centre = -R.T @ p
    lines = [np.stack([centre, centre + end]) for end in ends]
    under = sketch.under(instrument.seat)
    yield sketch.placed("instrument", instrument.name, under, lines, centre[None])


def _sockets(sketch: _Sketch, instrument: Socket, _: slice) -> Iterator[SceneObject]:
    places = {n: sketch.found.places[n] for n in instrument.names if n in sketch.found.places}
    left = list(places)
    while left:
        first = places[left[0]][:3]
        near = [n for n in left if np.linalg.norm(places[n][:3] - first) < _CLOSE * sketch.length]
        left = [n for n in left if n not in near]
        words = near[0] if not near[1:] else _common(near) or ", ".join(near)
        for name in near:
            own = _still("socket", name, [], places[name][None, :3])
            yield replace(own, words=words if name == near[0] else "")


def _common(names: Sequence[str]) -> str:
    """What several names begin with.

    >>> _common(["left_0", "left_1"])
    'left'
    """
    first, last = min(names), max(names)
    same = sum(
        1 for _ in takewhile(lambda pair: pair[0] == pair[1], zip(first, last, strict=False))
    )
    return first[:same].rstrip("_-. ")


def _sphere(sketch: _Sketch, instrument: Sphere, _: slice) -> Iterator[SceneObject]:
    place = sketch.found.places.get(instrument.name)
    if place is not None:
        radius = float(place[3]) if instrument.radius is None else instrument.radius
        level = ring(place[:3], radius)
        yield _still("sphere", instrument.name, [level], place[None, :3], abs(radius))


def _plane(sketch: _Sketch, instrument: Plane, part: slice) -> Iterator[SceneObject]:
    place = sketch.found.places.get(instrument.name)
    if place is None:
        return
    normal = so3_exp(np.array([*place[:2], 0.0]))[:, 2]
    touched = sketch.markers(instrument)[sketch.seen(part)]
    middle = touched.mean(axis=0) if len(touched) else np.zeros(3)
    middle = middle + normal * (place[2] - normal @ middle)
    half = max(_PATCH * sketch.length, float(np.abs(touched - middle).max(initial=0.0)))
    u, v = across(normal)
    lines = grid_lines(middle, u, v, half, half / 2.0)
    yield _still("touched", instrument.name, lines, middle[None])


def _wire(sketch: _Sketch, instrument: Distance, part: slice) -> Iterator[SceneObject]:
    """From the anchor to the marker, where it is read."""
    place = sketch.found.places.get(instrument.name)
    anchor = instrument.anchor if instrument.known or place is None else place[:3]
    if anchor is None:
        return
    markers, seen = sketch.markers(instrument), sketch.seen(part)
    under = sketch.under(instrument.seat)
    start = anchor[None, None] if under is None else sketch.on(under, anchor[None])
    there = np.where(seen[..., None], markers, start)
    begin = np.broadcast_to(start[:, 0], there[:, 0].shape)
    lines = [np.stack([begin, end], axis=1) for end in there.swapaxes(0, 1)]
    yield _moving("wire", instrument.name, lines, start, start)


_Draw: TypeAlias = Callable[..., Iterator[SceneObject]]
_DRAWN: dict[type[Instrument], _Draw] = {
    FixedCamera: _fixed_camera,
    ArmCamera: _arm_camera,
    Pose: _bodies,
    Socket: _sockets,
    Sphere: _sphere,
    Plane: _plane,
    Distance: _wire,
    Instrument: _stand,  # of any other kind
}
