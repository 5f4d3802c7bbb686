"""What the instruments see. A hidden marker is a missing row, it forbids no configuration."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from calib.arrays import Array, IntArray, Mask
from calib.cell.contacts import contacts_of, touched
from calib.cell.planned import HalfSpace
from calib.instruments import Camera, Instrument
from calib.instruments.board import Board
from calib.instruments.riding import frame_of, taken
from doe.constraints.distances import point_segment, segment_segment
from doe.constraints.obstacles import obstacles_of
from doe.constraints.scene import BASE, PlacedCapsule, Scene, turned

_SKIN = 1e-6  # m; a marker this close to a surface is mounted on it
_SLACK = 1e-12
_WRIST = 1  # joints before the last one whose shapes may hold what is mounted beyond it


def read_by(scene: Scene) -> Mask:
    """Readings that each configuration is for, shape (n, C): where it touches, that one alone."""
    contacts, which = contacts_of(scene.cell), touched(scene.cell, scene.q)
    read = np.ones((len(scene), len(scene.cell.channels)), dtype=bool)
    read[:, [contact.channel for contact in contacts]] = False
    for k, contact in enumerate(contacts):
        read[which == k] = np.arange(read.shape[1]) == contact.channel
    return read


def visible(scene: Scene) -> Mask:
    """Whether each reading can be had at each configuration, shape (n, C): of a tracker each marker.

    What is touched is read where it is (:func:`read_by`). All else is hidden by a capsule across the
    beam, unless the marker itself sits in it (a print on the tip sits in the wrist alone); by a box
    or a ball across the beam, unless the instrument itself stands in it; by turning away further
    than its acceptance, a quarter turn where only its normal is known; where it is not in a camera's
    image, or its board faces away. All are seen where nobody said where the instrument stands.
    """
    seen = read_by(scene)
    for instrument, part in scene.cell.channels.blocks:
        if isinstance(instrument, Camera):
            seen[:, part] &= instrument.found(taken(instrument, scene.markers))
        for beam in _beams(scene, instrument, part):
            seen[:, beam.channels] &= _free(scene, beam)[:, None]
        if isinstance(instrument, Camera):
            for board in instrument.boards:
                points = _channels(board, part)
                seen[:, points] &= board.enough(seen[:, points])[:, None]
    return seen


def _channels(board: Board, part: slice) -> IntArray:
    """The positions of a board's points among all readings of a cell, part : those of the camera."""
    return np.arange(part.start + board.channels.start, part.start + board.channels.stop)


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
            points = _channels(board, part)
            single -= set(points.tolist())
            printed = board.printed > 0.0 and instrument.each == 1
            for few, one in board.parts():
                if (at := instrument.sees_from(board, one)) is not None:
                    eye, channels = _placed(scene, instrument, at), points[few].tolist()
                    yield _Beam(channels, int(marker[points[one]]), eye, rides, printed)
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


def _free(scene: Scene, beam: _Beam) -> Mask:
    """Whether nothing hides a beam's marker, shape (n,)."""
    free, holders = _facing(scene, beam), _holders(scene, beam.marker)
    marker = scene.markers[:, beam.marker]
    for capsule in scene.capsules:
        # A board is in no link but those it is mounted on.
        may_hold = not beam.printed or capsule.body in holders
        free &= ~_behind(scene, capsule, beam, free, may_hold)
    for obstacle in obstacles_of(scene.cell):
        holds = (
            isinstance(obstacle.body, HalfSpace) or not obstacle.distance(beam.eye, beam.eye).all()
        )
        if not holds:
            at = np.flatnonzero(free)
            free[at] = obstacle.distance(beam.eye[at], marker[at]) > _SKIN
    return free


def _holders(scene: Scene, j: int) -> set[int]:
    """Frames whose shapes may hold marker j: its tip, and the last joints before that."""
    frame, holders = int(scene.cell.marker_frames[j]), set[int]()
    for _ in range(_WRIST + 2):
        holders.add(frame)
        frame = scene.cell.robot.parents[frame - 1] if frame else BASE
    return holders - {BASE}


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
    return np.asarray(np.einsum("ni,ni->n", normal, along) >= (least - _SLACK) * size)


def _behind(scene: Scene, capsule: PlacedCapsule, beam: _Beam, among: Mask, may_hold: bool) -> Mask:
    """Whether a capsule is across a beam, shape (n,); may_hold : unless the marker sits in it."""
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
