"""What the instruments see. A hidden marker is a missing row, it forbids no configuration."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from calib.arrays import Array, IntArray, Mask
from calib.cell.contacts import contacts_of, touched
from calib.instruments import Camera, Distance, Instrument
from calib.instruments.detection import Board
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
        for channels, marker, at, printed in _beams(scene, instrument, part):
            obstacles = [
                o
                for o in obstacles_of(scene.cell)
                if o.ball is not None and o.from_point(np.atleast_2d(at)).max() > 0.0
            ]
            for why, hidden in _hidden(scene, marker, at, obstacles, printed):
                for channel in channels:
                    yield why, channel, hidden


def _beams(
    scene: Scene, instrument: Instrument, part: slice
) -> Iterator[tuple[list[int], int, Array, bool]]:
    """Lines of sight, one for each channel; of a board, a few for all its points.

    Yields the channels that it stands for, its marker on the arm, its end, (3,) in the world or (n, 3)
    where the instrument rides, and whether that marker is on a print.
    """
    marker, single = scene.cell.channels.marker, set(range(part.start, part.stop))
    if isinstance(instrument, Camera):
        for board in instrument.boards:
            own = _channels(board, part)
            single -= set(own.tolist())
            for few, one in board.parts():
                if (at := instrument.sees_from(board, one)) is not None:
                    printed = board.printed > 0.0 and instrument.each == 1
                    at = _placed(scene, instrument, at)
                    yield own[few].tolist(), int(marker[own[one]]), at, printed
    if (at := instrument.position) is not None:
        for channel in sorted(single):
            yield [channel], int(marker[channel]), _placed(scene, instrument, at), False


def _placed(scene: Scene, instrument: Instrument, at: Array) -> Array:
    """A place (3,) as an instrument states it, in base axes: (n, 3) where it rides on a link."""
    if instrument.seat is None:
        return at
    origin, axes = frame_of(scene.markers[:, instrument.seat])
    return origin + at @ axes


def _holders(scene: Scene, j: int) -> set[int]:
    """Frames whose shapes may hold marker j: its tip, and the last joints before that."""
    frame, found = int(scene.cell.marker_frames[j]), set[int]()
    for _ in range(_WRIST + 2):
        found.add(frame)
        frame = scene.cell.robot.parents[frame - 1] if frame else BASE
    return found - {BASE}


def _hidden(
    scene: Scene, j: int, instrument: Array, obstacles: Sequence[Obstacle], printed: bool
) -> Iterator[tuple[str, Mask]]:
    """Cause by cause, the configurations (n,) where it is the first to hide marker j.

    printed : whether it is on a board, which is in no link but those it is mounted on
    """
    marker, free, holders = scene.markers[:, j], _facing(scene, j, instrument), _holders(scene, j)
    yield "turned away", ~free
    for capsule in scene.capsules:
        may_hold = not printed or capsule.body in holders
        hidden = _behind_capsule(marker, capsule, instrument, free, may_hold)
        free &= ~hidden
        yield f"behind {capsule.name}", hidden
    for obstacle in obstacles:
        hidden = _behind_obstacle(marker, obstacle, instrument, free)
        free &= ~hidden
        yield f"behind {obstacle.name}", hidden


def _facing(scene: Scene, j: int, instrument: Array) -> Mask:
    """Whether the beam meets marker j within its acceptance, shape (n,)."""
    if np.isnan(scene.cell.marker_normals[j]).any():
        return np.ones(len(scene), dtype=bool)
    cell, acceptance = scene.cell, scene.cell.marker_acceptance[j]
    least = 0.0 if np.isnan(acceptance) else float(np.cos(acceptance))
    beam = instrument - scene.markers[:, j]
    size = np.linalg.norm(beam, axis=1)
    normal = turned(scene.frames.R[:, cell.marker_frames[j]], cell.marker_normals[j])
    within = np.einsum("ni,ni->n", normal, beam) - least * size
    return np.asarray(within >= -_SLACK * size)


def _behind_capsule(
    marker: Array, capsule: PlacedCapsule, instrument: Array, among: Mask, may_hold: bool
) -> Mask:
    near = point_segment(capsule.centre, instrument, marker) < capsule.reach
    at = np.flatnonzero(near & among)
    start, end = capsule.start[at], capsule.end[at]
    hidden = np.zeros(len(among), dtype=bool)
    eye = _at(instrument, at)
    crossed = segment_segment(eye, marker[at], start, end) < capsule.radius
    if instrument.ndim > 1:  # what it rides on does not hide what it sees
        crossed &= point_segment(eye, start, end) > capsule.radius + _SKIN
    outside = point_segment(marker[at], start, end) > capsule.radius + _SKIN
    hidden[at] = crossed & (outside | (not may_hold))
    return hidden


def _at(instrument: Array, chosen: IntArray) -> Array:
    """Where the instrument is at some of the configurations: (3,) where it is at one place at all."""
    return instrument if instrument.ndim == 1 else instrument[chosen]


def _behind_obstacle(marker: Array, obstacle: Obstacle, instrument: Array, among: Mask) -> Mask:
    hidden = np.zeros(len(among), dtype=bool)
    if obstacle.ball is None:
        return hidden
    centre, radius = obstacle.ball
    at = np.flatnonzero(among & (point_segment(centre, instrument, marker) <= radius))
    start = np.broadcast_to(_at(instrument, at), (len(at), 3))
    hidden[at] = obstacle.from_segment(start, marker[at]) <= _SKIN
    return hidden
