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
    Tracker,
)
from calib.model.build import build, parse_effect
from calib.model.model import Model
from calib.poses import Measurements, Poses
from doe.constraints import Scene
from studies.report.surroundings import (
    SceneObject,
    grid_lines,
    hull,
    hull_runs,
    whole_mm,
)

_NEAR = 3.0  # arm lengths; what stands farther from the middle is not drawn


DROPPED = ("camera", "socket", "wire", "instrument")
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
    middle = (frame.min(axis=0) + frame.max(axis=0)) / 2e3
    kept: list[SceneObject] = []
    beyond: dict[str, float] = {}
    for own in drawn:
        away = float(np.linalg.norm(own.label - middle, axis=-1).max())
        if own.label.size == 3 and away > _NEAR * length / 1e3:
            beyond[own.name] = float(np.linalg.norm(own.label))
        else:
            kept.append(own)
    points = [own.points for own in kept]
    points += [own.label.reshape(-1, 3) * [1, 1, 0] for own in kept if own.kind in DROPPED]
    return tuple(kept), beyond, hull(np.concatenate([frame, *map(whole_mm, points)]))


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
            return SceneObject(kind, name, lines, dots, label, name)
        *moved, dots, label = (self.on(frame, points) for points in (*lines, dots, label))
        stem = self.scene.origins[:, [frame]]
        return SceneObject(kind, name, moved, dots, label, name, stem=stem)

    def board(
        self, name: str, frame: int | None, points: Array, runs: list[list[int]]
    ) -> SceneObject:
        """A board by its points (k, 3), m; of many only the outline."""
        dots = points if len(points) <= _DOTS else points[:0]
        middle = points.mean(axis=0, keepdims=True)
        return self.placed("board", name, frame, [points[run] for run in runs], dots, middle)

    def axes(
        self, kind: str, name: str, frame: int | None, origin: Array, axes: Array
    ) -> SceneObject:
        """A frame by its axes, rows of (3, 3), from its origin."""
        lines = [np.stack([origin, origin + axis * _TRIAD * self.length]) for axis in axes]
        return self.placed(kind, name, frame, lines, origin[None])

    def seen(self, part: slice) -> Array:
        """Which of its readings there are, (m, k)."""
        count = part.stop - part.start
        if isinstance(self.plan, Measurements):
            return np.asarray(self.plan.seen[:, part])
        return np.ones((len(self.scene), count), dtype=bool)

    def cone(self, camera: Camera, frame: int | None, centre: Array, axes: Array) -> SceneObject:
        """A camera and what it sees, up to some distance: axes (3, 3) by rows."""
        fx, fy, cx, cy = camera.lens.values[:4]
        size = np.array([2.0 * cx, 2.0 * cy]) if camera.image is None else camera.image

        def at(shares: Array) -> Array:
            ideal = (shares * size - [cx, cy]) / [fx, fy]
            rays = np.column_stack([ideal, np.ones(len(ideal))])
            return np.asarray(centre + rays @ axes * _CONE * self.length)

        rim = at(_SQUARE)
        lines = [rim, at(_UP), *(np.stack([centre, corner]) for corner in rim[:4])]
        return self.placed("camera", camera.name, frame, lines, centre[None])


def _fixed_camera(sketch: _Sketch, camera: FixedCamera, _: slice) -> Iterator[SceneObject]:
    place = sketch.found.places.get(camera.name)
    if place is not None:
        R = so3_exp(place[3:6])
        yield sketch.cone(camera, sketch.under(camera.seat), -R.T @ place[:3], R)
    for board in camera.boards:
        part = sketch.cell.bodies[board.name]
        points, runs = sketch.found.markers[part], hull_runs(board.points)
        yield sketch.board(board.name, sketch.under(part), points, runs)


def _arm_camera(sketch: _Sketch, camera: ArmCamera, _: slice) -> Iterator[SceneObject]:
    part = sketch.cell.bodies[camera.name]
    yield sketch.cone(camera, sketch.under(part), *_origin_and_axes(sketch.found.markers[part]))
    places = sketch.found.places.get(camera.name, np.zeros(0)).reshape(-1, 6)
    for board, place in zip(camera.boards, places, strict=False):
        points = board.points @ so3_exp(place[3:]).T + place[:3]
        yield sketch.board(board.name, None, points, hull_runs(points))


def _origin_and_axes(body: Array) -> tuple[Array, Array]:
    """Of a body's points (3, 3), its origin and one along x and y, axes as rows."""
    o, x, y = body
    return o, np.stack([x - o, y - o, np.cross(x - o, y - o)])


def _bodies(sketch: _Sketch, instrument: Pose, _: slice) -> Iterator[SceneObject]:
    yield from _stand(sketch, instrument, _)
    read = instrument.read_of(len(sketch.found.markers))
    for j, own in zip(read[::3], sketch.found.markers[read].reshape(-1, 3, 3), strict=True):
        name = sketch.cell.marker_names[j]
        frame = sketch.under(sketch.cell.bodies[name])
        yield sketch.axes("frame", name, frame, *_origin_and_axes(own))


def _stand(sketch: _Sketch, instrument: Instrument, _: slice) -> Iterator[SceneObject]:
    """Where its axes stand; one whose place the cell gives is drawn with its lines of sight."""
    place = sketch.found.places.get(instrument.name)
    framed = instrument.unknowns[:6] == Tracker.unknowns
    if place is None or instrument.position is not None or not framed:
        return
    R, p = Tracker.placement(place[:6])
    yield sketch.axes("instrument", instrument.name, sketch.under(instrument.seat), -R.T @ p, R)


def _sockets(sketch: _Sketch, instrument: Socket, _: slice) -> Iterator[SceneObject]:
    places = {n: sketch.found.places[n] for n in instrument.names if n in sketch.found.places}
    left = list(places)
    while left:
        first = places[left[0]][:3]
        near = [n for n in left if np.linalg.norm(places[n][:3] - first) < _CLOSE * sketch.length]
        left = [n for n in left if n not in near]
        words = near[0] if not near[1:] else _common(near) or ", ".join(near)
        for name in near:
            at = places[name][None, :3]
            yield SceneObject("socket", name, [], at, at, words if name == near[0] else "")


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
    yield sketch.placed("touched", instrument.name, None, lines, middle[None])


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
    yield SceneObject("wire", instrument.name, lines, start, start, instrument.name)


_Draw: TypeAlias = Callable[..., Iterator[SceneObject]]
_DRAWN: dict[type[Instrument], _Draw] = {
    FixedCamera: _fixed_camera,
    ArmCamera: _arm_camera,
    Pose: _bodies,
    Socket: _sockets,
    Plane: _plane,
    Distance: _wire,
    Instrument: _stand,  # of any other kind
}
