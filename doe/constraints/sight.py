"""What the instruments see. A hidden marker is a missing row, it forbids no configuration."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, IntArray, Mask
from calib.cell.contacts import contacts_of, touched
from calib.instruments import Camera, Distance, Instrument
from calib.instruments.board import Board
from calib.instruments.riding import frame_of, taken
from doe.constraints.distances import point_segment, segment_segment
from doe.constraints.obstacles import Obstacle, obstacles_of
from doe.constraints.scene import BASE, PlacedCapsule, Scene, turned

_SKIN = 1e-6  # m; a marker this close to a surface is mounted on it
_SLACK = 1e-12
_WRIST = 1  # joints before the last one whose shapes may hold what is mounted beyond it


def read_by(scene: Scene) -> Mask:
    """Readings that each configuration is for, shape (n, C): where it touches, that one alone."""
    contacts, which = contacts_of(scene.cell), touched(scene.cell, scene.q)
    found = np.ones((len(scene), len(scene.cell.channels)), dtype=bool)
    found[:, [contact.channel for contact in contacts]] = False
    for k, contact in enumerate(contacts):
        found[which == k] = np.arange(found.shape[1]) == contact.channel
    return found


def visible(scene: Scene) -> Mask:
    """Whether each reading can be had at each configuration, shape (n, C): of a tracker each marker.

    What is touched is read where it is (:func:`read_by`). All else is hidden by a capsule across the
    beam, unless the marker itself sits in it (a print on the tip sits in the wrist alone); by a box
    or a ball across the beam, unless the instrument itself stands in it; by turning away further
    than its acceptance, a quarter turn where only its normal is known; where it is not in a camera's
    image, or its board faces away; and out of the reach of a bar or wire. All are seen where nobody
    said where the instrument stands.
    """
    seen = read_by(scene)
    for _, channel, hidden in _hidings(scene):
        seen[hidden, channel] = False
    for instrument, part in scene.cell.channels.blocks:
        if isinstance(instrument, Camera):
            for board in instrument.boards:
                own = _channels(board, part)
                seen[:, own] &= board.enough(seen[:, own])[:, None]
    return seen


def _channels(board: Board, part: slice) -> IntArray:
    """The positions of a board's points among all readings of a cell, part : those of the camera."""
    return np.arange(part.start + board.channels.start, part.start + board.channels.stop)


def hidden_by(scene: Scene) -> dict[tuple[int, int], str]:
    """What hides a marker, by configuration and channel: ``turned away`` or ``behind A3``.

    Of several causes the first one found. What is not in it, is seen where the pose is for it
    (:func:`visible`).
    """
    return {(int(i), c): why for why, c, hidden in _hidings(scene) for i in np.flatnonzero(hidden)}


def _hidings(scene: Scene) -> Iterator[tuple[str, int, Mask]]:
    """Cause, channel, and the configurations (n,) where it is the first to hide its marker."""
    for instrument, part in scene.cell.channels.blocks:
        if isinstance(instrument, Camera | Distance):
            points = taken(instrument, scene.markers)
            if isinstance(instrument, Camera):
                why, read = "not found in the image", instrument.found(points)
            else:
                why, read = "out of reach", instrument.within(points)
            for channel, own in enumerate(read.T, part.start):
                yield why, channel, ~own
        for beam in _beams(scene, instrument, part):
            for why, hidden in _hidden(scene, beam):
                for channel in beam.channels:
                    yield why, channel, hidden


@dataclass(frozen=True, eq=False)
class _Beam:
    """A line of sight.

    channels : those that it stands for: of a board, a few of its points
    marker : int, at its one end; eye : ndarray, shape (n, 3), m, base axes, its other end
    rides : whether the instrument does; printed : whether the marker is on a print
    """

    channels: list[int]
    marker: int
    eye: Array
    rides: bool
    printed: bool = False


def _beams(scene: Scene, instrument: Instrument, part: slice) -> Iterator[_Beam]:
    """Lines of sight, one for each channel; of a board, a few for all its points."""
    marker, single = scene.cell.channels.marker, set(range(part.start, part.stop))
    rides = instrument.seat is not None
    if isinstance(instrument, Camera):
        for board in instrument.boards:
            own = _channels(board, part)
            single -= set(own.tolist())
            printed = board.printed > 0.0 and instrument.each == 1
            for few, one in board.parts():
                if (at := instrument.sees_from(board, one)) is not None:
                    eye = _placed(scene, instrument, at)
                    yield _Beam(own[few].tolist(), int(marker[own[one]]), eye, rides, printed)
    if (at := instrument.position) is not None:
        eye = _placed(scene, instrument, at)
        for channel in sorted(single):
            yield _Beam([channel], int(marker[channel]), eye, rides)


def _placed(scene: Scene, instrument: Instrument, at: Array) -> Array:
    """A place (3,) as an instrument states it, in base axes, shape (n, 3)."""
    if instrument.seat is None:
        return np.broadcast_to(at, (len(scene), 3))
    origin, axes = frame_of(scene.markers[:, instrument.seat])
    return np.asarray(origin + at @ axes)


def _hidden(scene: Scene, beam: _Beam) -> Iterator[tuple[str, Mask]]:
    """Cause by cause, the configurations (n,) where it is the first to hide a beam's marker."""
    free, holders = _facing(scene, beam), _holders(scene, beam.marker)
    yield "turned away", ~free
    for capsule in scene.capsules:
        # A board is in no link but those it is mounted on.
        may_hold = not beam.printed or capsule.body in holders
        hidden = _behind_capsule(scene, capsule, beam, free, may_hold)
        free &= ~hidden
        yield f"behind {capsule.name}", hidden
    for obstacle in obstacles_of(scene.cell):
        if obstacle.ball is not None and (obstacle.from_point(beam.eye) > 0.0).any():
            hidden = _behind_obstacle(scene, obstacle, obstacle.ball, beam, free)
            free &= ~hidden
            yield f"behind {obstacle.name}", hidden


def _holders(scene: Scene, j: int) -> set[int]:
    """Frames whose shapes may hold marker j: its tip, and the last joints before that."""
    frame, found = int(scene.cell.marker_frames[j]), set[int]()
    for _ in range(_WRIST + 2):
        found.add(frame)
        frame = scene.cell.robot.parents[frame - 1] if frame else BASE
    return found - {BASE}


def _facing(scene: Scene, beam: _Beam) -> Mask:
    """Whether a beam meets its marker within its acceptance, shape (n,)."""
    cell, j = scene.cell, beam.marker
    if np.isnan(cell.marker_normals[j]).any():
        return np.ones(len(scene), dtype=bool)
    acceptance = cell.marker_acceptance[j]
    least = 0.0 if np.isnan(acceptance) else float(np.cos(acceptance))
    along = beam.eye - scene.markers[:, j]
    size = np.linalg.norm(along, axis=1)
    normal = turned(scene.frames.R[:, cell.marker_frames[j]], cell.marker_normals[j])
    within = np.einsum("ni,ni->n", normal, along) - least * size
    return np.asarray(within >= -_SLACK * size)


def _behind_capsule(
    scene: Scene, capsule: PlacedCapsule, beam: _Beam, among: Mask, may_hold: bool
) -> Mask:
    marker = scene.markers[:, beam.marker]
    near = point_segment(capsule.centre, beam.eye, marker) < capsule.reach
    at = np.flatnonzero(near & among)
    start, end, eye = capsule.start[at], capsule.end[at], beam.eye[at]
    crossed = segment_segment(eye, marker[at], start, end) < capsule.radius
    if beam.rides:  # what it rides on does not hide what it sees
        crossed &= point_segment(eye, start, end) > capsule.radius + _SKIN
    outside = point_segment(marker[at], start, end) > capsule.radius + _SKIN
    hidden = np.zeros(len(among), dtype=bool)
    hidden[at] = crossed & (outside | (not may_hold))
    return hidden


def _behind_obstacle(
    scene: Scene, obstacle: Obstacle, ball: tuple[Array, float], beam: _Beam, among: Mask
) -> Mask:
    marker = scene.markers[:, beam.marker]
    at = np.flatnonzero(among & (point_segment(ball[0], beam.eye, marker) <= ball[1]))
    hidden = np.zeros(len(among), dtype=bool)
    hidden[at] = obstacle.from_segment(beam.eye[at], marker[at]) <= _SKIN
    return hidden
